"""Detections of a mission, from its folder or from its result."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import shapely

from pavetwin.detections import NO_DETECTIONS, SIZES, Detections
from pavetwin.errors import PaveTwinError
from pavetwin.inventory.entry import entry_model
from pavetwin.inventory.reading import Reading
from pavetwin.labels.class_names import TRAFFIC
from pavetwin.mission.folder import MissionFolder, detector_of
from pavetwin.mission.result import MissionResult
from pavetwin.perception.images import read_photograph
from pavetwin.perception.measuring import check_size
from pavetwin.world.georeference import GeoReference, anchored, from_wgs84

FRAMES: Final = "frames"

NO_CROPS: Final = "There are no crops; `pavetwin fly WORLD --save-frames hits` saves the images for them."

_OF_IMAGES: Final = {"capture": pl.Int64, "image": pl.String}
"""Columns of the table of images."""


def flown_together(folders: Sequence[Path], *, position_error_m: float = 0.0, fitted: str | None = None) -> Reading:
    """Detections of several missions over one place, in the frame of the first; see `flown`.

    A mission that cannot be read adds a remark.

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
        names = [f"{folder}, {image}" for image in mine.detections.image]
        readers = {f"{folder}, {image}": reader for image, reader in mine.readers.items()}
        read.append(replace(mine, detections=mine.detections.with_columns(image=names), readers=readers))
    if not read:
        raise wrong[0]
    # Entries of several detectors are judged by none.
    detectors = {reading.detector for reading in read}
    return Reading(
        detections=Detections.concatenated([reading.detections for reading in read]),
        readers={image: reader for reading in read for image, reader in reading.readers.items()},
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
    """All detections of defects of a mission, as an agency gets them, without their outcomes.

    Args:
        mission: the mission, or its folder.
        position_error_m: standard deviation of the camera's position, east and north each; 0 in the simulation.
        frame: frame of the footprints, such as the world's; by default one with its origin at the first detection.
        fitted: fitted sensor for the probability of entries, see `pavetwin.inventory.entry.entry_model`.

    Raises:
        PaveTwinError: its description, its detections or its table of images are missing or damaged, the error is out
            of its bounds, or `fitted` does not fit.
    """
    check_size("position_error_m", position_error_m, may_be_zero=True)
    mission = mission if isinstance(mission, MissionFolder) else MissionFolder(mission)
    table = mission.detections
    found = table.filter(~pl.col("class").is_in(list(TRAFFIC)))
    images = _images(mission.folder)
    captures = table["capture"].n_unique()
    detector = mission.detector
    known = entry_model(detector, fitted)
    if found.is_empty():
        return Reading(
            NO_DETECTIONS,
            None,
            captures,
            detector=detector,
            entry_model=known,
            is_of_measuring=mission.measures_sizes,
        )
    frame = frame or anchored(found["latitude"][0], found["longitude"][0])
    detections = _of_table(found, frame).with_columns(position_error_m=[position_error_m] * len(found))
    readers = {f"capture {capture}": partial(read_photograph, image) for capture, image in images.items()}
    return Reading(detections, frame, captures, () if images else (NO_CROPS,), detector, known, readers=readers)


def reported(result: MissionResult) -> Reading:
    """Detections of a mission whose sensor measures sizes, without files: those that `flown` reads from its folder."""
    detector = detector_of(result.settings.sensing, result.spec.plugins)
    found = result.detections[result.detections.is_defect]
    return Reading(
        found.with_columns(image=[f"capture {capture}" for capture in found.capture]),
        result.environment.world.georeference,
        len(np.unique(result.detections.capture)),
        detector=detector,
        entry_model=entry_model(detector),
        is_of_measuring=True,
    )


def _of_table(table: pl.DataFrame, frame: GeoReference) -> Detections:
    """The rows of `detections.parquet`, with footprints in a metric frame."""
    degrees = shapely.from_wkb(table["footprint"].to_list())
    numbers: dict[str, Any] = {name: table[name].cast(pl.Float64).to_numpy() for name in (*SIZES, "pixel_mm")}
    return Detections(
        table["class"].to_list(),
        table["confidence"].to_numpy(),
        image=[f"capture {capture}" for capture in table["capture"]],
        capture=table["capture"].to_numpy(),
        footprint=shapely.transform(degrees, partial(from_wgs84, frame)),
        **numbers,
        severity=[severity or "" for severity in table["severity"]],
        is_cut=table["is_cut"].fill_null(value=False).to_numpy(),
    )


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
