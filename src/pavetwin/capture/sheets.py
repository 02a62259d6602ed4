"""Contact sheets of captured datasets, with their labels, and of missions, with what the sensor reported and missed.

A cell of a mission's sheet shows the sensor's image around one object: outlines of defects are continuous, those of
reported detections are dashed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image, ImageColor, ImageDraw
from shapely import Polygon

from pavetwin.capture.mission_images import MissionImages
from pavetwin.capture.platforms import PLATFORMS, flying
from pavetwin.capture.record import Record, read_record, record_paths
from pavetwin.capture.settings import read_description
from pavetwin.capture.truth import LabelledObject
from pavetwin.detections import Detections, Outcome
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, check_sheet, cut_around, draw_box, evenly_chosen
from pavetwin.draw.mission_style import font
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.files import writing
from pavetwin.labels import SPLITS
from pavetwin.labels.class_names import display_name
from pavetwin.labels.classes import category_colours, colours
from pavetwin.labels.rle import decode
from pavetwin.mission.inspected_defects import captured_frame
from pavetwin.mission.result import MissionResult
from pavetwin.sensing import Sensor
from pavetwin.sensing.detector import DetectorSensor

_MASK_ALPHA: Final = 0.28


def save_sheet(folder: Path, path: Path, *, count: int = 24, split: str | None = None) -> int:
    """Draw `count` images of a dataset, evenly chosen over its indices, into a PNG or JPEG. Returns how many.

    Raises:
        PaveTwinError: the folder holds no image, or none of that split, or the file cannot be written.
    """
    description = read_description(folder)
    if split is not None and split not in SPLITS:
        raise PaveTwinError(f"`split`: no split '{split}'{nearest_name(split, SPLITS)}; there are {', '.join(SPLITS)}.")
    check_sheet(path, count)
    found = record_paths(folder, split)
    if not found:
        which = f"no {split} image" if split else "no image"
        raise PaveTwinError(f"'{folder}' holds {which} yet.")
    records = [read_record(found[index]) for index in evenly_chosen(len(found), count)]
    title = f"{folder.absolute().name}   {_summary(description, len(found), split)}"
    sheet = contact_sheet(folder, records, title=title)
    with writing(path) as temporary:
        sheet.save(temporary, quality=90)
    return len(records)


def contact_sheet(folder: Path, records: Sequence[Record], *, title: str) -> Image.Image:
    """The images of `records` with their labels, in rows, under a title and a legend."""
    colour_of = colours(read_description(folder)["classes"])
    cells = [_cell(folder, record, colour_of) for record in records]
    return assembled(cells, title, colour_of, ignored="ignored (hidden, cut, far, small or faint)")


def annotated(
    picture: Image.Image, objects: Iterable[LabelledObject], colour_of: Mapping[str, str], scale: float = 1.0
) -> Image.Image:
    """A picture, scaled, with the masks and boxes of its objects; ignored ones are dashed and have no mask.

    Args:
        colour_of: by class.
    """
    shown = sorted(objects, key=lambda obj: (obj.ignored is None, -obj.area_px))
    size = round(picture.width * scale), round(picture.height * scale)
    small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    for obj in shown:
        if obj.ignored is None:
            mask = decode(obj.mask, (picture.height, picture.width)).astype(np.uint8) * round(255 * _MASK_ALPHA)
            soft = Image.fromarray(mask).resize(size, Image.Resampling.BOX)
            small.paste(Image.new("RGB", size, colour_of[obj.category]), mask=soft)
    pen = ImageDraw.Draw(small)
    for obj in shown:
        edges = obj.box[0] * scale, obj.box[1] * scale, obj.box[2] * scale, obj.box[3] * scale
        draw_box(pen, edges, colour_of[obj.category] if obj.ignored is None else None)
    for obj in shown:
        if obj.ignored is None:
            _tag(pen, obj, colour_of[obj.category], scale, size)
    return small


def pose_text(camera: Mapping[str, Any]) -> str:
    """Height and tilt of a camera that flies (`10 m, tilted 12°`); else which of the platform's cameras it is."""
    platform = camera["platform"]
    if platform not in PLATFORMS.names() or not flying([platform]):  # the plugin of another may not be given here
        return str(camera["mount"])
    tilt = f", tilted {90 + camera['pitch_deg']:.0f}°" if camera["pitch_deg"] >= -87.5 else ""
    resolution = f"{camera['gsd_mm']:.2g} mm/px, " if "frame_px" in camera and camera["gsd_mm"] else ""
    return f"{resolution}{round(camera['altitude_m'], 1):g} m{tilt}"


def _cell(folder: Path, record: Record, colour_of: Mapping[str, str]) -> Image.Image:
    path = folder / record.image
    try:
        with Image.open(path) as file:
            picture = file.convert("RGB")
    except OSError as error:
        raise PaveTwinError(f"'{path}' is damaged or missing; capture into another folder.") from error
    drawn = annotated(picture, record.objects, colour_of, CELL_PX / picture.width)
    camera, light = record.camera, record.light
    number = record.name.rpartition("-")[2]
    heading = f"{camera['platform']} {number}  {record.split}"
    sky = f"sun {light['sun_elevation_deg']:.0f}°, cloud {100 * light['cloud_cover']:.0f} %"
    text = f"{pose_text(camera)} · {record.traffic['density']} traffic · {sky}"
    ignored = sum(obj.ignored is not None for obj in record.objects)
    right = f"{len(record.labelled)} labels" + (f", {ignored} ignored" if ignored else "")
    return captioned(drawn, heading, text, right)


def _tag(pen: ImageDraw.ImageDraw, obj: LabelledObject, colour: str, scale: float, size: tuple[int, int]) -> None:
    """Write a defect's severity over its box, or below its upper edge if there is no space above."""
    text = obj.details.get("severity")
    if text is None:
        return
    face = font(10, bold=True)
    width, height = pen.textlength(text, face) + 6, 13
    left = min(max(0.0, obj.box[0] * scale - 1), size[0] - width)
    top = obj.box[1] * scale - height - 1
    top = top if top >= 0 else obj.box[1] * scale + 1
    pen.rectangle((left, top, left + width, top + height), fill=colour)
    pen.text((left + 3, top + 1), text, _on(colour), face)


def _on(colour: str) -> str:
    """Black or white, whichever can be read on a colour."""
    red, green, blue = ImageColor.getrgb(colour)[:3]
    return "#000000" if 0.299 * red + 0.587 * green + 0.114 * blue > 110 else "#FFFFFF"


def _summary(description: dict[str, Any], count: int, split: str | None) -> str:
    settings, images = description["settings"], f"{count} {split} images" if split else f"{count} images"
    world, platforms = description["world"]["name"], " and ".join(settings["platforms"])
    return f"{images} of the world {world}, {platforms}, seed {settings['seed']}"


OF_EACH: Final = 6  # Cells of what was found, of what was missed and of false alarms, at most
_LEAST_M: Final = 2.0  # Side of what a cell shows, at least; else so many times what it is about:
_MARGIN: Final = 1.8

_QUALITY: Final = 90


@dataclass(frozen=True)
class _Cell:
    """One object in one capture."""

    capture: int
    shape: Polygon
    """Outline of the object on the ground."""
    kind: str
    heading: str
    text: str
    reported: bool
    """True for a shape that the sensor reported; else it is the outline of a defect."""


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
    shown = {display_name(each.kind) for each in cells}
    legend = {name: colour for name, colour in category_colours().items() if name in shown}
    sheet = assembled(pictures, _title(result), legend, ignored="reported")
    with writing(path) as temporary:
        sheet.save(temporary, "JPEG", quality=_QUALITY)
    return len(cells)


def _order(cell: _Cell) -> tuple[int, int]:
    return ("found", "missed", "false alarm").index(cell.heading.partition(":")[0]), cell.capture


def _title(result: MissionResult) -> str:
    missed = sum(not each.is_found for each in result.inspected_defects)
    alarms = int((result.detections.outcome == Outcome.FALSE_ALARM).sum())
    defects = len(result.inspected_defects)
    return (
        f"{result.environment.world.name}   {defects - missed} of {defects} defects found, {alarms} false alarms, "
        f"{result.settings.altitude_m:g} m, {result.policy}"
    )


def _found(result: MissionResult) -> list[_Cell]:
    return _reported(result.confirmed, "found")


def _false_alarms(result: MissionResult) -> list[_Cell]:
    return _reported(result.detections[result.detections.outcome == Outcome.FALSE_ALARM], "false alarm")


def _reported(detections: Detections, outcome: str) -> list[_Cell]:
    """Cells of some detections, evenly chosen."""
    rows = evenly_chosen(len(detections), OF_EACH) if len(detections) else []
    return [
        _Cell(
            int(detections.capture[row]),
            detections.footprint[row],
            detections.class_name[row],
            f"{outcome}: {display_name(detections.class_name[row])}",
            f"confidence {detections.confidence[row]:.2f}",
            True,
        )
        for row in rows
    ]


def _missed(result: MissionResult) -> list[_Cell]:
    """Missed defects that a capture showed, the largest first."""
    shown = [each for each in result.inspected_defects if not each.is_found and each.capture is not None]
    shown.sort(key=lambda each: -each.defect.polygon.area)
    cells = []
    for each in shown[:OF_EACH]:
        assert each.capture is not None
        visible = "" if each.visible_fraction is None else f", {each.visible_fraction:.0%} visible"
        words = f"{each.defect.severity.value}, {'' if each.reason is None else each.reason.value.replace('_', ' ')}"
        heading = f"missed: {display_name(each.defect.kind)}"
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
    draw_box(ImageDraw.Draw(window), box, None if cell.reported else category_colours()[display_name(cell.kind)])
    return captioned(window, cell.heading, cell.text, f"capture {cell.capture}")
