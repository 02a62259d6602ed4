"""A contact sheet of a mission whose sensor looked at images: what it found, what it missed, and its false alarms.

Each cell shows the image as the sensor had it, around one object: outlines of what is there are continuous, those of
what the sensor reported are dashed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PIL import Image, ImageDraw
from shapely import Polygon

from pavetwin.capture.mission_images import MissionImages
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, cut_around, draw_box, evenly_chosen
from pavetwin.files import writing
from pavetwin.labels.classes import category_colours, label_name
from pavetwin.mission.inspected_defects import captured_frame
from pavetwin.mission.result import MissionResult
from pavetwin.sensing import Outcome, Sensor
from pavetwin.sensing.detector import DetectorSensor

if TYPE_CHECKING:
    from pavetwin.sensing import JudgedDetection

OF_EACH: Final = 6
"""Cells of what was found, of what was missed and of false alarms, at most."""

_LEAST_M: Final = 2.0
"""Side of what a cell shows, at least; else so many times what it is about:"""
_MARGIN: Final = 1.8

_QUALITY: Final = 90


@dataclass(frozen=True)
class _Cell:
    """One object in one capture."""

    capture: int
    shape: Polygon
    """What it is about, on the ground."""
    kind: str
    heading: str
    text: str
    reported: bool
    """Whether the shape is what the sensor reported; else the outline of a defect."""


def save_mission_sheet(result: MissionResult, images: MissionImages, sensor: Sensor, path: Path) -> int:
    """Draw the sheet into a JPEG; nothing is drawn where there is nothing to show. Returns how many cells it has.

    Args:
        images: of the mission's environment, traffic and seed.
        sensor: that it was flown with.

    Raises:
        PaveTwinError: the file cannot be written, or there is no adapter to draw with.
    """
    cells = [*_found(result), *_missed(result), *_false_alarms(result)]
    if not cells:
        return 0
    pictures = [_drawn(each, result, images, sensor) for each in sorted(cells, key=_order)]
    shown = {label_name(each.kind) for each in cells}
    legend = {name: colour for name, colour in category_colours().items() if name in shown}
    sheet = assembled(pictures, _title(result), legend, ignored="reported")
    with writing(path) as temporary:
        sheet.save(temporary, "JPEG", quality=_QUALITY)
    return len(cells)


def _order(cell: _Cell) -> tuple[int, int]:
    return ("found", "missed", "false alarm").index(cell.heading.partition(":")[0]), cell.capture


def _title(result: MissionResult) -> str:
    missed = sum(not each.is_found for each in result.inspected_defects)
    alarms = sum(each.outcome is Outcome.FALSE_ALARM for each in result.detections)
    defects = len(result.inspected_defects)
    return (
        f"{result.environment.world.name}   {defects - missed} of {defects} defects found, {alarms} false alarms, "
        f"{result.settings.altitude_m:g} m, {result.policy}"
    )


def _chosen(detections: Sequence["JudgedDetection"]) -> "list[JudgedDetection]":
    return [detections[at] for at in evenly_chosen(len(detections), OF_EACH)] if detections else []


def _found(result: MissionResult) -> list[_Cell]:
    return [_reported(each, "found", result) for each in _chosen(result.confirmed)]


def _false_alarms(result: MissionResult) -> list[_Cell]:
    alarms = [each for each in result.detections if each.outcome is Outcome.FALSE_ALARM]
    return [_reported(each, "false alarm", result) for each in _chosen(alarms)]


def _reported(detection: "JudgedDetection", outcome: str, result: MissionResult) -> _Cell:
    shape = detection.footprint
    if shape is None:
        assert detection.defect is not None
        shape = result.environment.defects[detection.defect].polygon
    heading = f"{outcome}: {label_name(detection.kind)}"
    return _Cell(detection.capture, shape, detection.kind, heading, f"confidence {detection.confidence:.2f}", True)


def _missed(result: MissionResult) -> list[_Cell]:
    """Those that a capture showed, the largest first."""
    shown = [each for each in result.inspected_defects if not each.is_found and each.capture is not None]
    shown.sort(key=lambda each: -each.defect.polygon.area)
    cells = []
    for each in shown[:OF_EACH]:
        assert each.capture is not None
        visible = "" if each.visible_fraction is None else f", {each.visible_fraction:.0%} visible"
        words = f"{each.defect.severity.value}, {'' if each.reason is None else each.reason.value.replace('_', ' ')}"
        heading = f"missed: {label_name(each.defect.kind)}"
        cells.append(_Cell(each.capture, each.defect.polygon, each.defect.kind, heading, words + visible, False))
    return cells


def _drawn(cell: _Cell, result: MissionResult, images: MissionImages, sensor: Sensor) -> Image.Image:
    frame = captured_frame(result, cell.capture)
    if isinstance(sensor, DetectorSensor):
        frame = replace(frame, camera=sensor.seen_camera(frame.camera))
    least_px = _LEAST_M / frame.ground_resolution_m
    window, box = cut_around(
        Image.fromarray(images(frame)), frame.box_of(cell.shape), margin=_MARGIN, least_px=least_px, size_px=CELL_PX
    )
    draw_box(ImageDraw.Draw(window), box, None if cell.reported else category_colours()[label_name(cell.kind)])
    return captioned(window, cell.heading, cell.text, f"capture {cell.capture}")
