"""Pictures of the entries: the part of an image around the best detection, and pages of them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from pavetwin.arrays import UInt8Array
from pavetwin.detections import Detections
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, cut_around, draw_box
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.inventory.entry import Entry
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.class_names import display_name
from pavetwin.labels.classes import category_colours

A_PAGE: Final = 24
"""Crops on a page."""

_MARGIN: Final = 1.6
"""Side of a crop over the longer side of the box."""

_LEAST_PX: Final = 96

_QUALITY: Final = 88


def around(pixels: UInt8Array, box: FloatBox) -> UInt8Array:
    """(side, side, 3) The square part of a picture (height, width, 3) around a box, which is drawn in it; black beyond
    the picture."""
    part, edges = cut_around(Image.fromarray(pixels), box, margin=_MARGIN, least_px=_LEAST_PX)
    draw_box(ImageDraw.Draw(part), edges, "#FFFFFF")
    return np.asarray(part)


def write_crops(
    entries: Sequence[Entry], folder: Path, crop: Callable[[Detections], UInt8Array | None]
) -> dict[int, str]:
    """Write the crop of each entry whose image is available, and pages of them; returns the names by entry number.

    Args:
        crop: the part of an image around a detection (`Reading.crop`).

    Raises:
        PaveTwinError: a file cannot be written.
    """
    names: dict[int, str] = {}
    cells: list[Image.Image] = []
    for entry in entries:
        picture = _crop(entry, crop)
        if picture is None:
            continue
        names[entry.number] = f"crops/{entry.number:04}.jpg"
        with writing(folder / names[entry.number]) as temporary:
            picture.save(temporary, "JPEG", quality=_QUALITY)
        cells.append(_cell(entry, picture))
    named = sorted({display_name(entry.class_name) for entry in entries if entry.number in names})
    colour_of = {name: colour for name, colour in category_colours().items() if name in named}
    for start, page in zip(range(0, len(cells), A_PAGE), page_names(len(cells)), strict=True):
        shown = cells[start : start + A_PAGE]
        title = f"Inventory   {start + 1} to {start + len(shown)} of {len(cells)} entries with a picture"
        with writing(folder / page) as temporary:
            assembled(shown, title, colour_of, ignored="").save(temporary, "JPEG", quality=_QUALITY)
    return names


def page_names(crops: int) -> list[str]:
    """Files of the pages of so many crops."""
    return [f"crops-{page + 1:02}.jpg" for page in range(-(-crops // A_PAGE))]


def _crop(entry: Entry, crop: Callable[[Detections], UInt8Array | None]) -> Image.Image | None:
    try:
        pixels = crop(entry.best)
    except PaveTwinError:  # the image is gone or damaged since it was searched
        return None
    return None if pixels is None else Image.fromarray(pixels)


def _cell(entry: Entry, picture: Image.Image) -> Image.Image:
    size = entry.sizes.get("length_m") or entry.sizes.get("area_m2")
    unit = "m" if "length_m" in entry.sizes else "m²"
    words = [f"{size.value:.2f} ± {size.error:.2f} {unit}"] if size else []
    words += [entry.severity] if entry.severity else []
    looks = f"{entry.looks} look{'s' * (entry.looks != 1)}"
    text = ", ".join([*words, looks])
    sure = f"confidence {entry.confidence:.2f}"
    if entry.probability is not None:
        sure += f", a defect: {100 * entry.probability:.0f} %"
    return captioned(
        picture.resize((CELL_PX, CELL_PX)), f"{entry.number}: {display_name(entry.class_name)}", text, sure
    )
