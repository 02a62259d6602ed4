"""Observations of a mission: what its sensor reported, from its folder alone, or from its result."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import shapely
from PIL import Image
from shapely import Polygon

from pavetwin.arrays import UInt8Array
from pavetwin.detections import NOT_RESOLVABLE, SIZES
from pavetwin.errors import PaveTwinError
from pavetwin.inventory.crops import around
from pavetwin.inventory.observation import Observation
from pavetwin.inventory.probability import entry_model
from pavetwin.inventory.reading import Reading
from pavetwin.labels.class_names import TRAFFIC, display_name
from pavetwin.mission.folder import MissionFolder, detector_of
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import detections_table
from pavetwin.perception.images import pixels_of
from pavetwin.perception.measuring import check_size
from pavetwin.perception.photograph import pose_of
from pavetwin.world.georeference import GeoReference, anchored, from_wgs84

FRAMES: Final = "frames"

NO_CROPS: Final = "There are no crops; `pavetwin fly WORLD --save-frames hits` saves the images for them."

_OF_IMAGES: Final = {"capture": pl.Int64, "image": pl.String}
"""Columns of the table of images."""


def flown_together(folders: Sequence[Path], *, position_error_m: float = 0.0, fitted: str | None = None) -> Reading:
    """What the sensors of several missions over one place reported, in the frame of the first; see `flown`.

    A mission that cannot be read is a remark.

    Raises:
        PaveTwinError: none can be read.
    """
    read: list[Reading] = []
    wrong: list[PaveTwinError] = []
    frame: GeoReference | None = None
    for folder in folders:
        try:
            mine = flown(folder, position_error_m=position_error_m, frame=frame, fitted=fitted)
        except PaveTwinError as error:
            wrong.append(error)
            continue
        frame = frame or mine.frame
        named = (replace(each, image=f"{folder}, {each.image}") for each in mine.observations)
        read.append(replace(mine, observations=tuple(named)))
    if not read:
        raise wrong[0]
    # Entries of several detectors are judged by none.
    detectors = {reading.detector for reading in read}
    return Reading(
        observations=tuple(each for reading in read for each in reading.observations),
        detector=read[0].detector if len(detectors) == 1 else None,
        entry_model=read[0].entry_model if len(detectors) == 1 else None,
        frame=frame,
        images=sum(reading.images for reading in read),
        is_of_measuring=all(reading.is_of_measuring for reading in read),
        remarks=tuple(dict.fromkeys((*map(str, wrong), *(each for reading in read for each in reading.remarks)))),
    )


def flown(
    mission: MissionFolder | Path,
    *,
    position_error_m: float = 0.0,
    frame: GeoReference | None = None,
    fitted: str | None = None,
) -> Reading:
    """What the sensor of a mission reported: all its detections of defects, as an agency gets them, without the
    judgement of what is there.

    Args:
        mission: the mission, or its folder.
        position_error_m: standard deviation of the camera's position, east and north each; 0 in the simulation.
        frame: of the places; unless given, one whose origin is the first detection.
        fitted: the sensor that tells how likely entries are defects, see `pavetwin.inventory.probability.entry_model`.

    Raises:
        PaveTwinError: its description, its detections or its table of images are missing or damaged, the error is out
            of its bounds, or `fitted` does not fit.
    """
    check_size("position_error_m", position_error_m, may_be_zero=True)
    mission = mission if isinstance(mission, MissionFolder) else MissionFolder(mission)
    table = mission.detections
    rows = _of_defects(table)
    images = _images(mission.folder)
    captures = table["capture"].n_unique()
    remarks = () if images or not rows else (NO_CROPS,)
    detector = mission.detector
    known = entry_model(detector, fitted)
    if not rows:
        measures = mission.measures_sizes
        return Reading((), None, captures, remarks, detector=detector, entry_model=known, is_of_measuring=measures)
    frame = frame or anchored(rows[0]["latitude"], rows[0]["longitude"])
    observations = tuple(_observed(row, frame, images, position_error_m) for row in rows)
    return Reading(observations, frame, captures, remarks, detector, known)


def reported(result: MissionResult) -> Reading:
    """What a sensor that measures sizes reported in a mission, without files: as `flown` reads it from the mission's
    folder."""
    table = detections_table(result)
    detector = detector_of(result.settings.sensing, result.spec.plugins)
    frame = result.environment.world.georeference
    observations = tuple(_observed(row, frame, {}, 0.0) for row in _of_defects(table))
    return Reading(
        observations,
        frame,
        table["capture"].n_unique(),
        detector=detector,
        entry_model=entry_model(detector),
        is_of_measuring=True,
    )


def _of_defects(table: pl.DataFrame) -> list[dict[str, Any]]:
    return [row for row in table.iter_rows(named=True) if row["class"] not in TRAFFIC]


def _images(folder: Path) -> Mapping[int, Path]:
    """The image of each capture that was saved.

    Raises:
        PaveTwinError: the table of images is damaged.
    """
    path = folder / FRAMES / "captures.csv"
    if not path.is_file():
        return {}
    try:
        table = pl.read_csv(path, columns=list(_OF_IMAGES), schema_overrides=_OF_IMAGES)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise _damaged(path) from error
    if any(table.null_count().row(0)):
        raise _damaged(path)
    return {capture: folder / FRAMES / image for capture, image in table.select(*_OF_IMAGES).iter_rows()}


def _damaged(path: Path) -> PaveTwinError:
    return PaveTwinError(
        f"'{path}' is damaged; remove it for an inventory without crops, or fly the mission again by "
        "`pavetwin fly WORLD --save-frames hits`."
    )


def _observed(row: Mapping[str, Any], frame: GeoReference, images: Mapping[int, Path], error_m: float) -> Observation:
    degrees = shapely.from_wkb(row["footprint"])
    outline = shapely.transform(degrees, partial(from_wgs84, frame))
    assert isinstance(outline, Polygon)
    image = images.get(row["capture"])
    return Observation(
        kind=display_name(row["class"]),
        confidence=row["confidence"],
        image=f"capture {row['capture']}",
        box_px=None,
        footprint=outline,
        sizes={name: row[name] for name in SIZES if row[name] is not None},
        severity=_severity(row["severity"]),
        pixel_m=None if row["pixel_mm"] is None else row["pixel_mm"] / 1000,
        position_error_m=error_m,
        is_cut=bool(row["is_cut"]),
        crop=None if image is None else partial(_crop, image, degrees),
    )


def _severity(text: str | None) -> str:
    return "" if text is None or text == NOT_RESOLVABLE else text


def _crop(image: Path, degrees: Polygon) -> UInt8Array | None:
    """The part of a saved frame around an outline in WGS 84."""
    pixels = pixels_of(image)
    with Image.open(image) as held:
        corners = pose_of(held).pixels(shapely.get_coordinates(degrees))
    if corners is None:
        return None
    (left, top), (right, bottom) = np.min(corners, axis=0).tolist(), np.max(corners, axis=0).tolist()
    return around(pixels, (left, top, right, bottom))
