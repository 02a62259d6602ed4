"""Contact sheets: images in rows under a title and a legend of classes, with boxes drawn over them."""

from collections.abc import Mapping, Sequence
from math import ceil, floor
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from pavetwin.draw.mission_style import font, write
from pavetwin.draw.style import INK, INK_SOFT, PAPER
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.classes import colours
from pavetwin.labels.common_form import AnnotatedImage, annotation_path, image_names, read_description, read_image
from pavetwin.labels.voc import PICTURES

CELL_PX: Final = 420
"""Width of one image on the sheet."""

CAPTION_PX: Final = 46  # Height of the two lines below an image
_GAP_PX, _MARGIN_PX, _TITLE_PX, _LEGEND_PX = 18, 36, 40, 28
_HALO, _IGNORED = "#101010", "#E8E8E8"
_DASH_PX: Final = 5


def check_sheet(path: Path, count: int) -> None:
    """Refuse what no sheet can be.

    Raises:
        PaveTwinError: another kind of file, or no image.
    """
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise PaveTwinError(f"A contact sheet cannot be written as '{path.name}'; end its name in .png or .jpg.")
    if count < 1:
        raise PaveTwinError(f"`count` {count}: a contact sheet shows at least one image.")


def evenly_chosen(total: int, count: int) -> list[int]:
    """Up to `count` indices of `total` > 0 things, the first and the last among them."""
    chosen: list[int] = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int)).tolist()
    return chosen


def assembled(cells: Sequence[Image.Image], title: str, colour_of: Mapping[str, str], *, ignored: str) -> Image.Image:
    """Cells in rows. A title's first word, up to three spaces, is written large.

    Args:
        colour_of: by class, for the legend.
        ignored: what dashed boxes mean; empty where there are none.
    """
    columns = _columns(len(cells))
    rows = [cells[start : start + columns] for start in range(0, len(cells), columns)]
    heights = [max(cell.height for cell in row) for row in rows]
    width = columns * CELL_PX + (columns - 1) * _GAP_PX
    legend = _legend(colour_of, ignored, width)
    top = _MARGIN_PX + _TITLE_PX + _LEGEND_PX * (1 + legend[-1][1]) + _LEGEND_PX
    size = 2 * _MARGIN_PX + width, _MARGIN_PX + top + sum(heights) + _GAP_PX * (len(rows) - 1)
    sheet = Image.new("RGB", size, PAPER)
    _header(sheet, title, legend, colour_of)
    for row, height in zip(rows, heights, strict=True):
        for column, cell in enumerate(row):
            sheet.paste(cell, (_MARGIN_PX + column * (CELL_PX + _GAP_PX), top))
        top += height + _GAP_PX
    return sheet


def captioned(drawn: Image.Image, heading: str, text: str, right: str) -> Image.Image:
    """A cell: an image of `CELL_PX` pixels' width, and two lines below it."""
    cell = Image.new("RGB", (CELL_PX, drawn.height + CAPTION_PX), PAPER)
    cell.paste(drawn, (0, 0))
    pen = ImageDraw.Draw(cell)
    room = CELL_PX - pen.textlength(right, font(13)) - _GAP_PX
    pen.text((0, drawn.height + 5), _shortened(heading, room), INK, font(15, bold=True))
    pen.text((0, drawn.height + 25), text, INK_SOFT, font(13))
    pen.text((CELL_PX, drawn.height + 5), right, INK_SOFT, font(13), anchor="ra")
    return cell


def _shortened(heading: str, room: float) -> str:
    """A heading, without its middle where it is wider than the room in pixels: names differ at their ends."""
    shown, kept = heading, len(heading)
    while kept and font(15, bold=True).getlength(shown) > room:
        kept -= 1
        shown = f"{heading[: kept // 3]}…{heading[len(heading) - kept + kept // 3 :]}"
    return shown


def _columns(count: int) -> int:
    """About three columns for two rows, with the last row as full as possible."""
    wanted = (count * 1.5) ** 0.5
    choices = range(max(1, floor(0.8 * wanted)), max(1, ceil(1.25 * wanted)) + 1)
    return min(min(choices, key=lambda columns: (-count % columns, abs(columns - wanted))), count)


def _legend(colour_of: Mapping[str, str], ignored: str, width: float) -> list[tuple[float, int, str]]:
    """Entries as (left, line, words): as many on a line as it has room for."""
    entries, left, line = list[tuple[float, int, str]](), 0.0, 0
    for words in filter(None, (*colour_of, ignored)):
        needed = 26 + font(16).getlength(words)
        if left and left + needed > width:
            left, line = 0.0, line + 1
        entries.append((left, line, words))
        left += needed + 30
    return entries


def _header(
    sheet: Image.Image, title: str, legend: Sequence[tuple[float, int, str]], colour_of: Mapping[str, str]
) -> None:
    pen = ImageDraw.Draw(sheet)
    name, _, rest = title.partition("   ")
    end = write(pen, (_MARGIN_PX, _MARGIN_PX - 8), name, 26, bold=True, fill=INK)
    write(pen, (end + 16, _MARGIN_PX + 1), rest, 17, fill=INK_SOFT)
    for left, line, words in legend:
        x, y = _MARGIN_PX + left, _MARGIN_PX + _TITLE_PX + _LEGEND_PX * line
        if words in colour_of:
            pen.rectangle((x, y, x + 18, y + 18), fill=colour_of[words], outline=INK)
        else:
            _dashed(pen, (x, y, x + 18, y + 18), INK_SOFT)
        pen.text((x + 26, y), words, INK, font(16))


def cut_around(
    picture: Image.Image, box: FloatBox, *, margin: float, least_px: float, size_px: int | None = None
) -> tuple[Image.Image, FloatBox]:
    """The square part of an image around a box, black beyond the image; and the box in pixels of the part.

    Args:
        margin: side of the part over the longer side of the box.
        least_px: that side in the image, at least.
        size_px: side of the result; as in the image, but at least `CELL_PX`, unless given.
    """
    left, top, right, bottom = box
    side = ceil(max(least_px, margin * max(right - left, bottom - top)))
    x, y = round((left + right - side) / 2), round((top + bottom - side) / 2)
    size = size_px or max(side, CELL_PX)
    part = picture.crop((x, y, x + side, y + side)).resize((size, size), Image.Resampling.BICUBIC)
    scale = size / side
    return part, ((left - x) * scale, (top - y) * scale, (right - x) * scale, (bottom - y) * scale)


def draw_box(pen: ImageDraw.ImageDraw, box: FloatBox, colour: str | None) -> None:
    """A box in pixels of what is drawn on; dashed where it has no colour, since it is ignored."""
    left, top, right, bottom = box
    if colour is None:
        _dashed(pen, box, _IGNORED)
        return
    pen.rectangle((left - 2, top - 2, right + 1, bottom + 1), outline=_HALO)
    pen.rectangle((left - 1, top - 1, right, bottom), outline=colour, width=2)


def _dashed(pen: ImageDraw.ImageDraw, box: FloatBox, colour: str) -> None:
    left, top, right, bottom = box
    for start, end, is_flat in ((left, right, True), (top, bottom, False)):
        for at in np.arange(start, max(end, start + 1), 2 * _DASH_PX).tolist():
            to = min(at + _DASH_PX, end)
            for other in (top, bottom) if is_flat else (left, right):
                pen.line((at, other, to, other) if is_flat else (other, at, other, to), fill=colour)


def save_dataset_sheet(folder: Path, path: Path, *, count: int = 24) -> int:
    """Draw `count` images of a dataset, evenly chosen by name, into a PNG or JPEG. Returns how many.

    Raises:
        PaveTwinError: the folder holds no image, one is damaged, or the file cannot be written.
    """
    description = read_description(folder)
    check_sheet(path, count)
    names = image_names(folder)
    if not names:
        raise PaveTwinError(f"'{folder}' holds no image.")
    chosen = [names[index] for index in evenly_chosen(len(names), count)]
    colour_of = colours(description["classes"])
    cells = [_cell(folder, read_image(annotation_path(folder, name)), colour_of) for name in chosen]
    of = f"{len(names)} images" if len(names) != 1 else "1 image"
    title = f"{folder.absolute().name}   {len(cells)} of {of}"
    sheet = assembled(cells, title, colour_of, ignored="ignored: neither an object nor background")
    with writing(path) as temporary:
        sheet.save(temporary, quality=90)
    return len(cells)


def _cell(folder: Path, image: AnnotatedImage, colour_of: dict[str, str]) -> Image.Image:
    path = folder / PICTURES / image.picture
    try:
        with Image.open(path, formats=("JPEG", "PNG")) as file:
            picture = file.convert("RGB")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PaveTwinError(f"'{path}' is damaged or missing; make the dataset again.") from error
    scale = CELL_PX / picture.width
    drawn = picture.resize((CELL_PX, max(1, round(picture.height * scale))), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(drawn)
    for each in sorted(image.annotations, key=lambda each: each.ignored is None):
        left, top, right, bottom = each.box
        is_shown = each.ignored is None and each.category is not None
        colour = colour_of[each.category] if is_shown and each.category is not None else None
        draw_box(pen, (left * scale, top * scale, right * scale, bottom * scale), colour)
    ignored = len(image.annotations) - len(image.labelled)
    labels = "1 label" if len(image.labelled) == 1 else f"{len(image.labelled)} labels"
    count = labels if not image.is_background else "background"
    resolution = "" if image.gsd_mm is None else f" · {image.gsd_mm:.3g} mm a pixel"
    width, height = image.size_px
    return captioned(
        drawn,
        image.name,
        f"{image.source} · {width} × {height}{resolution}",
        count + (f", {ignored} ignored" if ignored else ""),
    )
