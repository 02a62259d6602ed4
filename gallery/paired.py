"""A sheet of photographs, each beside a frame of the same ground resolution and subject."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from gallery.frame_matcher import FrameMatcher
from gallery.matched import Pair, Photograph, photographs, pictures_in
from gallery.renderer import GalleryRenderer, Picture
from gallery.sheet import captioned, grid
from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.markings import LINE_WIDTH_M
from pavetwin.training.datasets.sources.base import DatasetSource

SHOWN: Final = 24
CELL_PX: Final = 212
LINE_PX: Final = 2
"""Between a photograph and its frame."""


def evenly(found: Sequence[Photograph]) -> list[int]:
    """Places of `SHOWN` of them, from fine to coarse, evenly chosen."""
    ordered = sorted(range(len(found)), key=lambda index: (found[index].gsd_m, found[index].name))
    count = min(SHOWN, len(ordered))
    return [ordered[index * len(ordered) // count] for index in range(count)]


def paired_sheet(pairs: Sequence[Pair], source: DatasetSource | None) -> Picture:
    """Photographs, each with the frame of its ground resolution to its right; below, whose photographs they are."""
    cells = []
    for index in evenly([photograph for photograph, _ in pairs]):
        photograph, frame = pairs[index]
        left, right = (
            np.asarray(each.resize((CELL_PX, CELL_PX), Image.Resampling.LANCZOS))
            for each in (photograph.picture, frame)
        )
        both = np.concatenate([left, np.full((CELL_PX, LINE_PX, 3), 255, np.uint8), right], axis=1)
        what = "" if photograph.kind is None else f"   {photograph.kind.replace('_', ' ')}"
        cells.append(captioned(both, f"{1000 * photograph.gsd_m:.1f} mm a pixel{what}", height_px=CELL_PX))
    whole = grid(cells, columns=3)
    if source is None:
        return whole
    credit = f"Left: photographs of {source.title}, {source.licence}, {source.home}, cut and scaled. Right: frames."
    return captioned(whole, credit, height_px=whole.shape[0])


def beside_photographs(
    renderer: GalleryRenderer, folder: Path, source: DatasetSource | None, gsd_m: float | None
) -> Picture:
    """The sheet for a folder of photographs.

    Raises:
        PaveTwinError: no photograph there has a known ground resolution.
    """
    found = list(photographs(folder, pictures_in(folder), source=source, gsd_m=gsd_m, line_m=LINE_WIDTH_M))
    if not found:
        raise PaveTwinError(f"'{folder}' holds no photograph whose ground resolution is known; give it.")
    return paired_sheet(FrameMatcher(renderer).pairs(found[index] for index in evenly(found)), source)
