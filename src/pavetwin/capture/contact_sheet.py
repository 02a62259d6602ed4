"""A contact sheet: images of a dataset side by side, with their labels drawn over them."""

from collections.abc import Iterable, Mapping, Sequence
from math import ceil, floor
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from pavetwin.capture.platforms import PLATFORMS, flying
from pavetwin.capture.record import Record, read_record, record_paths
from pavetwin.capture.settings import SPLITS, read_description
from pavetwin.capture.truth import LabelledObject
from pavetwin.draw.mission_style import font, write
from pavetwin.draw.style import INK, INK_SOFT, PAPER
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.files import writing
from pavetwin.labels.classes import categories, colours
from pavetwin.labels.rle import decode

CELL_PX: Final = 420
"""Width of one image on the sheet."""

_GAP_PX, _MARGIN_PX, _CAPTION_PX, _HEADER_PX = 18, 36, 46, 96
_MASK_ALPHA: Final = 0.28
_HALO, _IGNORED = "#101010", "#E8E8E8"
_DASH_PX: Final = 5


def save_sheet(folder: Path, path: Path, *, count: int = 24, split: str | None = None) -> int:
    """Draw `count` images of a dataset, evenly chosen over its indices, into a PNG or JPEG. Returns how many.

    Raises:
        PaveTwinError: the folder holds no image, or none of that split, or the file cannot be written.
    """
    description = read_description(folder)
    if split is not None and split not in SPLITS:
        raise PaveTwinError(f"`split`: no split '{split}'{nearest_name(split, SPLITS)}; there are {', '.join(SPLITS)}.")
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise PaveTwinError(f"A contact sheet cannot be written as '{path.name}'; end its name in .png or .jpg.")
    if count < 1:
        raise PaveTwinError(f"`count` {count}: a contact sheet shows at least one image.")
    found = record_paths(folder, split)
    if not found:
        which = f"no {split} image" if split else "no image"
        raise PaveTwinError(f"'{folder}' holds {which} yet.")
    chosen = np.unique(np.linspace(0, len(found) - 1, min(count, len(found))).round().astype(int))
    records = [read_record(found[index]) for index in chosen.tolist()]
    title = f"{folder.absolute().name}   {_summary(description, len(found), split)}"
    sheet = contact_sheet(folder, records, title=title)
    with writing(path) as temporary:
        sheet.save(temporary, quality=90)
    return len(records)


def contact_sheet(folder: Path, records: Sequence[Record], *, title: str) -> Image.Image:
    """The images of `records` with their labels, in rows, under a title and a legend."""
    names = read_description(folder).get("classes") or [category.name for category in categories()]
    colour_of = colours(names)
    columns = _columns(len(records))
    rows = ceil(len(records) / columns)
    cells = [_cell(folder, record, colour_of) for record in records]
    height = max(cell.height for cell in cells)
    size = (
        2 * _MARGIN_PX + columns * CELL_PX + (columns - 1) * _GAP_PX,
        _MARGIN_PX + _HEADER_PX + rows * (height + _GAP_PX) + _MARGIN_PX - _GAP_PX,
    )
    sheet = Image.new("RGB", size, PAPER)
    _header(sheet, title, colour_of)
    for number, cell in enumerate(cells):
        row, column = divmod(number, columns)
        place = (_MARGIN_PX + column * (CELL_PX + _GAP_PX), _MARGIN_PX + _HEADER_PX + row * (height + _GAP_PX))
        sheet.paste(cell, place)
    return sheet


def _columns(count: int) -> int:
    """About three columns for two rows, and the last row as full as can be."""
    wanted = (count * 1.5) ** 0.5
    choices = range(max(1, floor(0.8 * wanted)), max(1, ceil(1.25 * wanted)) + 1)
    return min(min(choices, key=lambda columns: (-count % columns, abs(columns - wanted))), count)


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
        _box(pen, obj, colour_of[obj.category], scale)
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
    return f"{camera['altitude_m']:g} m{tilt}"


def _cell(folder: Path, record: Record, colour_of: Mapping[str, str]) -> Image.Image:
    path = folder / record.image
    try:
        with Image.open(path) as file:
            picture = file.convert("RGB")
    except OSError as error:
        raise PaveTwinError(f"'{path}' is damaged or missing; capture into another folder.") from error
    drawn = annotated(picture, record.objects, colour_of, CELL_PX / picture.width)
    cell = Image.new("RGB", (CELL_PX, drawn.height + _CAPTION_PX), PAPER)
    cell.paste(drawn, (0, 0))
    pen = ImageDraw.Draw(cell)
    camera, light = record.camera, record.light
    number = record.name.rpartition("-")[2]
    pen.text((0, drawn.height + 5), f"{camera['platform']} {number}  {record.split}", INK, font(15, bold=True))
    sky = f"sun {light['sun_elevation_deg']:.0f}°, cloud {100 * light['cloud_cover']:.0f} %"
    text = f"{pose_text(camera)} · {record.traffic['density']} traffic · {sky}"
    pen.text((0, drawn.height + 25), text, INK_SOFT, font(13))
    ignored = sum(obj.ignored is not None for obj in record.objects)
    right = f"{len(record.labelled)} labels" + (f", {ignored} ignored" if ignored else "")
    pen.text((CELL_PX, drawn.height + 5), right, INK_SOFT, font(13), anchor="ra")
    return cell


def _header(sheet: Image.Image, title: str, colour_of: Mapping[str, str]) -> None:
    pen = ImageDraw.Draw(sheet)
    name, _, rest = title.partition("   ")
    end = write(pen, (_MARGIN_PX, _MARGIN_PX - 8), name, 26, bold=True, fill=INK)
    write(pen, (end + 16, _MARGIN_PX + 1), rest, 17, fill=INK_SOFT)
    x = float(_MARGIN_PX)
    for category, colour in colour_of.items():
        pen.rectangle((x, _MARGIN_PX + 40, x + 18, _MARGIN_PX + 58), fill=colour, outline=INK)
        pen.text((x + 26, _MARGIN_PX + 40), category, INK, font(16))
        x += 26 + pen.textlength(category, font(16)) + 30
    _dashed(pen, (x, _MARGIN_PX + 40, x + 18, _MARGIN_PX + 58), INK_SOFT)
    pen.text((x + 26, _MARGIN_PX + 40), "ignored (hidden, cut, far, small or faint)", INK, font(16))


def _box(pen: ImageDraw.ImageDraw, obj: LabelledObject, colour: str, scale: float) -> None:
    left, top, right, bottom = (value * scale for value in obj.box)
    if obj.ignored is not None:
        _dashed(pen, (left, top, right, bottom), _IGNORED)
        return
    pen.rectangle((left - 2, top - 2, right + 1, bottom + 1), outline=_HALO)
    pen.rectangle((left - 1, top - 1, right, bottom), outline=colour, width=2)


def _dashed(pen: ImageDraw.ImageDraw, box: tuple[float, float, float, float], colour: str) -> None:
    left, top, right, bottom = box
    for start, end, is_flat in ((left, right, True), (top, bottom, False)):
        for at in np.arange(start, max(end, start + 1), 2 * _DASH_PX).tolist():
            to = min(at + _DASH_PX, end)
            for other in (top, bottom) if is_flat else (left, right):
                pen.line((at, other, to, other) if is_flat else (other, at, other, to), fill=colour)


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
