"""Looks of a detector at a captured dataset: one for each visible defect of each image."""

from collections.abc import Callable
from math import hypot, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import yaml
from shapely import Polygon, box

from pavetwin.capture.record import Record, read_record, record_paths
from pavetwin.capture.truth import LabelledObject
from pavetwin.detections import Detections
from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256
from pavetwin.labels.outlines import hull
from pavetwin.labels.rle import decode
from pavetwin.perception.detector import Detector
from pavetwin.sensing.detector import default_image_px
from pavetwin.sensing.fit.look_tables import ALARM_SCHEMA, CAPTURE, GROUP, LOOK_COLUMNS, LookSource
from pavetwin.sensing.fitted_sensor import FittedDetector
from pavetwin.sensing.frame import Look
from pavetwin.sensing.matching import match_shapes

LEAST_VISIBLE: Final = 0.35
"""Least visible fraction of a defect in a look; default of missions (`sensing.min_visible_fraction`)."""

LEAST_INSIDE: Final = 0.98
"""Images of missions show nearly whole what counts as a look, since its centre lies in the inspection window. Where two
thirds of the looks were at parts, chances depended too little on the resolution."""

LEVEL_DEG: Final = 5.0  # Images that look further from straight down are left out: missions take none


def is_capture(folder: Path) -> bool:
    """Return whether a folder is a dataset of `pavetwin capture`."""
    return (folder / "capture.yaml").is_file()


def looks_of(folder: Path, model: Path, confidence: float, on_progress: Callable[[float], None]) -> LookSource:
    """Run a detector on a dataset's images and compare its detections with the labels.

    Args:
        model: file of the detector.
        confidence: least confidence of what counts.
        on_progress: called with the finished share, 0 … 1.

    Raises:
        PaveTwinError: the dataset or the model is damaged, or no image looks straight down.
    """
    detector = Detector(model, confidence=confidence)
    if detector.tiled:  # the larger images of missions are always looked at in tiles, at their own resolution
        detector = Detector(model, confidence=confidence, tiled=True)
    place, paths = _place(folder), record_paths(folder)
    looks: list[tuple[Any, ...]] = []
    images: list[tuple[float, float]] = []
    alarms: list[tuple[int, str, float]] = []
    for number, path in enumerate(paths):
        record = read_record(path)
        if abs(90.0 + float(record.camera["pitch_deg"])) <= LEVEL_DEG:
            (found,) = detector.detect([folder / record.image])
            mine, wrong = _judged(record, found)
            looks += [(f"{place} {name.removeprefix('defect ')}", *rest) for name, *rest in mine]
            alarms += [(len(images), kind, size_px) for kind, size_px in wrong]
            images.append((_area_m2(record), float(record.camera["gsd_mm"])))
        on_progress((number + 1) / len(paths))
    if not images:
        raise PaveTwinError(f"'{folder}' has no image that looks straight down, as missions take them.")
    schema = {GROUP: pl.String, "found": pl.Boolean, **LOOK_COLUMNS}
    return LookSource(
        name=folder.name,
        detector=FittedDetector(sha256=file_sha256(model), confidence=confidence, image_px=default_image_px(detector)),
        looks=pl.DataFrame(looks, schema=schema, orient="row"),
        images=pl.DataFrame(images, schema={"area_m2": pl.Float64, "pixel_mm": pl.Float64}, orient="row").with_columns(
            pl.lit(None, pl.String).alias(CAPTURE)
        ),
        alarms=pl.DataFrame(alarms, schema=ALARM_SCHEMA, orient="row"),
    )


def _place(folder: Path) -> str:
    """Key of the world and its defects."""
    try:
        world = yaml.safe_load((folder / "capture.yaml").read_text(encoding="utf-8"))["world"]
        return f"{world['content_hash']} {world['defects_hash']}"
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError) as error:
        raise PaveTwinError(f"'{folder / 'capture.yaml'}' is damaged; capture into another folder.") from error


def _area_m2(record: Record) -> float:
    width, height = record.size_px
    return width * height * (float(record.camera["gsd_mm"]) / 1000.0) ** 2


def _judged(record: Record, found: Detections) -> tuple[list[tuple[Any, ...]], list[tuple[str, float]]]:
    """Looks as (defect, is found, look values), and false alarms as (class, size in pixels)."""
    pixel_m = float(record.camera["gsd_mm"]) / 1000.0
    height_width = (record.size_px[1], record.size_px[0])
    objects = [each for each in record.objects if each.id.startswith("defect ")]
    there = Detections(
        [each.details["class"] for each in objects],
        1.0,
        box_px=[each.box for each in objects],
        footprint=[Polygon(hull(decode(each.mask, height_width)) * pixel_m) for each in objects],
    )
    reported = found[found.is_defect]
    reported = reported.with_columns(footprint=[_footprint(reported, row, pixel_m) for row in range(len(reported))])
    matches = match_shapes(reported, there)
    hit = set(matches.defect.tolist())
    looks = []
    for index, each in enumerate(objects):
        off_centre = _off_centre(record, each)
        is_whole = each.inside_fraction is None or each.inside_fraction >= LEAST_INSIDE
        if each.visible_fraction >= LEAST_VISIBLE and is_whole and off_centre is not None:
            looks.append((each.id, index in hit, *_look(record, each, pixel_m, off_centre)))
    wrong = [
        (reported.class_name[row], sqrt(reported.footprint[row].area) / pixel_m)
        for row in np.flatnonzero(matches.defect < 0)
    ]
    return looks, wrong


def _footprint(found: Detections, row: int, pixel_m: float) -> Polygon:
    """The hull of a mask, or else the box, in metres from the image's corner."""
    mask = found.mask_pixels(row)
    corners = np.asarray(box(*found.box(row)).exterior.coords)
    if mask is not None and mask[1].any():
        corners = hull(mask[1]) + mask[0][:2]
    return Polygon(corners * pixel_m)


def _off_centre(record: Record, thing: LabelledObject) -> float | None:
    """The way of its centre to the image's centre as a share of that to a corner; None for one outside."""
    camera, size = record.camera, np.array(record.size_px)
    ahead = np.asarray(camera["rotation"]) @ (np.asarray(thing.position_m) - camera["position_m"])
    middle = np.array(camera["frame_px"]) / 2 - camera["corner_px"]
    place = ahead[:2] / ahead[2] * camera["focal_px"] + middle - size / 2
    return None if (np.abs(place) > size / 2).any() else float(np.hypot(*place) / np.hypot(*size) * 2)


def _look(record: Record, thing: LabelledObject, pixel_m: float, off_centre: float) -> Look:
    details, camera, light = thing.details, record.camera, record.light
    return Look(
        kind=str(details["class"]),
        severity=str(details["severity"]),
        width_px=float(details["width_m"]) / pixel_m,
        size_px=sqrt(float(details["area_m2"])) / pixel_m,
        pixel_mm=1000.0 * pixel_m,
        visible_fraction=thing.visible_fraction,
        inside_fraction=1.0 if thing.inside_fraction is None else thing.inside_fraction,
        off_centre=off_centre,
        blur_px=hypot(*camera["velocity_mps"][:2]) * float(camera["exposure_s"]) / pixel_m,
        sun_elevation_deg=float(light["sun_elevation_deg"]),
        clouds=float(light["cloud_cover"]),
    )
