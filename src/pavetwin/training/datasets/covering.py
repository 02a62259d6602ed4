"""Labels under pasted objects, and the labels of these objects.

By the share of an annotation's area that is still visible:

1. From `KEPT_SHARE` on it stays, with the box and the outline of what is visible.
2. Below that it is ignored, neither an object nor background.
3. Below `GONE_SHARE` it is left out.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.labels import CUT_OUT, outlines
from pavetwin.labels.boxes import of_mask
from pavetwin.labels.common_form import Annotation, Polygon
from pavetwin.training.datasets.augmenting import GONE_SHARE

KEPT_SHARE: Final = 0.6
"""Visible share of an annotation's area from which it stays a label."""

COVERED: Final = "covered"


def filled(annotation: Annotation, size_px: tuple[int, int]) -> BoolArray:
    """(height, width) What an annotation covers: its outline, or its box where that is too thin for a pixel."""
    if annotation.outline is not None:
        within = outlines.filled(np.array(annotation.outline), size_px)
        if within.any():
            return within
    mask = np.zeros(size_px[::-1], dtype=np.bool_)
    left, top, right, bottom = annotation.box
    mask[top:bottom, left:right] = True
    return mask


def covered(annotation: Annotation, over: BoolArray, size_px: tuple[int, int]) -> Annotation | None:
    """An annotation under objects; None where nothing is left of it.

    Args:
        over: (height, width) the pixels of the objects.
    """
    region = filled(annotation, size_px)
    visible = region & ~over
    if visible.sum() == region.sum():
        return annotation
    share, box = visible.sum() / region.sum(), of_mask(visible)
    if share < GONE_SHARE or box is None:
        return None
    ignored = COVERED if share < KEPT_SHARE and annotation.ignored is None else annotation.ignored
    shape = _outline(visible) if annotation.outline is not None else None
    return replace(annotation, box=box, outline=shape, ignored=ignored)


def pasted(mask: BoolArray, category: str, name: str) -> Annotation:
    """The label of an object that was put into an image.

    Args:
        mask: (height, width) its pixels.
        name: of its cut-out.
    """
    box = of_mask(mask)
    assert box is not None, "an object has pixels"
    return Annotation(category, box, outline=_outline(mask), original="cut out", attributes={CUT_OUT: name})


def _outline(mask: BoolArray) -> Polygon:
    return tuple((x, y) for x, y in outlines.boundary(mask).tolist())
