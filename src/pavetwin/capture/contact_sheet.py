"""A contact sheet: images of a dataset side by side, with their labels drawn over them."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from pavetwin.capture.platforms import PLATFORMS, flying
from pavetwin.capture.record import Record, read_record, record_paths
from pavetwin.capture.settings import read_description
from pavetwin.capture.truth import LabelledObject
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, check_sheet, draw_box, evenly_chosen
from pavetwin.draw.mission_style import font
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.files import writing
from pavetwin.labels import SPLITS
from pavetwin.labels.classes import categories, colours
from pavetwin.labels.rle import decode

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
    names = read_description(folder).get("classes") or [category.name for category in categories()]
    colour_of = colours(names)
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
    """Of a defect its severity, over the box; below its upper edge where there is no space above."""
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
