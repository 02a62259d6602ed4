"""What the detector says of one image."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from math import ceil, floor
from typing import Any, Final

import cv2
import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, IndexArray, Int64Array
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox, PixelBox
from pavetwin.perception.classes import CLASSES, SUBTYPES

IS_COVERED: Final = 0.5
"""Probability from which a pixel belongs to a mask."""


@dataclass(frozen=True, slots=True)
class MaskPart:
    """A mask within a box: all of a detection's, or what one tile saw of it."""

    box: FloatBox
    """In pixels of the image."""
    grid: Float32Array
    """(side, side) probabilities."""

    @property
    def cell_px(self) -> tuple[float, float]:
        """Width and height of a cell of the grid, in pixels of the image."""
        rows, columns = self.grid.shape
        return (self.box[2] - self.box[0]) / columns, (self.box[3] - self.box[1]) / rows


@dataclass(frozen=True)
class Detections:
    """Of one image, the most confident first."""

    size_px: tuple[int, int]
    """Width and height of the image."""
    boxes: Float32Array
    """(n, 4) left, top, right, bottom in pixels, within the image."""
    classes: Int64Array
    """(n,) number in `CLASSES`."""
    detection: Float32Array
    """(n,) confidence in the coarse class, 0 … 1."""
    subtype: Float32Array
    """(n,) confidence in the subtype of a defect, 0 … 1; 1 for persons and cars."""
    masks: tuple[tuple[MaskPart, ...], ...]
    """(n,) parts of the mask; none for what is no defect, or where the model has no mask head."""

    def __post_init__(self) -> None:
        count = len(self.boxes)
        assert self.boxes.shape == (count, 4)
        assert all(len(each) == count for each in (self.classes, self.detection, self.subtype, self.masks))

    def __len__(self) -> int:
        return len(self.boxes)

    @property
    def confidence(self) -> Float32Array:
        """(n,) the final one: detection × subtype."""
        return self.detection * self.subtype

    @property
    def names(self) -> list[str]:
        """(n,) of the classes."""
        return [CLASSES[number] for number in self.classes]

    @property
    def is_defect(self) -> BoolArray:
        """(n,)"""
        return self.classes < len(SUBTYPES)

    def box(self, at: int) -> FloatBox:
        """Left, top, right, bottom of one detection."""
        left, top, right, bottom = self.boxes[at].tolist()
        return left, top, right, bottom

    def chosen(self, rows: Sequence[int] | IndexArray) -> "Detections":
        """Some of them, in the order of their rows."""
        kept = np.asarray(rows, dtype=np.intp)
        masks = tuple(self.masks[at] for at in kept)
        return Detections(
            self.size_px, self.boxes[kept], self.classes[kept], self.detection[kept], self.subtype[kept], masks
        )

    def mask(self, at: int) -> tuple[PixelBox, BoolArray] | None:
        """The mask of one detection: a window (left, top, right, bottom) of the image, and its pixels.

        Returns:
            None where it has none.
        """
        if not self.masks[at]:
            return None
        left, top, right, bottom = self.boxes[at]
        window = (floor(left), floor(top), min(ceil(right), self.size_px[0]), min(ceil(bottom), self.size_px[1]))
        covered = np.zeros((max(1, window[3] - window[1]), max(1, window[2] - window[0])), dtype=np.bool_)
        for part in self.masks[at]:
            covered |= _pixels(part, window, (covered.shape[1], covered.shape[0]))
        return (window[0], window[1], window[0] + covered.shape[1], window[1] + covered.shape[0]), covered

    def to_supervision(self, *, masks: bool = True) -> Any:
        """As `supervision.Detections`, with both confidences and the class's name in `data`.

        Args:
            masks: with masks of the size of the image, which need much memory where it is large.

        Raises:
            PaveTwinError: supervision is not installed.
        """
        try:
            supervision: Any = import_module("supervision")
        except ImportError as error:
            raise PaveTwinError(
                "supervision is not installed, which is an extra; install it with `pip install pavetwin[detect]`."
            ) from error
        return supervision.Detections(
            xyxy=self.boxes.astype(np.float32),
            confidence=self.confidence,
            class_id=self.classes.astype(int),
            mask=self._whole_masks() if masks and any(self.masks) else None,
            data={"class_name": np.array(self.names), "det_conf": self.detection, "cls_conf": self.subtype},
        )

    def _whole_masks(self) -> BoolArray:
        found = np.zeros((len(self), self.size_px[1], self.size_px[0]), dtype=np.bool_)
        for at in range(len(self)):
            if (mask := self.mask(at)) is not None:
                (left, top, right, bottom), covered = mask
                found[at, top:bottom, left:right] = covered
        return found


def _pixels(part: MaskPart, window: PixelBox, size: tuple[int, int]) -> BoolArray:
    """The pixels of a window (width, height) whose middle a part covers, its grid interpolated linearly."""
    across, down = part.cell_px
    # From the middle of a pixel of the window to the grid, in which the middle of the first cell is 0.
    matrix = np.array(
        [
            [1 / across, 0.0, (window[0] + 0.5 - part.box[0]) / across - 0.5],
            [0.0, 1 / down, (window[1] + 0.5 - part.box[1]) / down - 0.5],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    shares = cv2.warpAffine(part.grid, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    x = np.arange(window[0], window[0] + size[0]) + 0.5
    y = np.arange(window[1], window[1] + size[1]) + 0.5
    inside_x, inside_y = (x >= part.box[0]) & (x <= part.box[2]), (y >= part.box[1]) & (y <= part.box[3])
    covered: BoolArray = (shares >= IS_COVERED) & inside_x & inside_y[:, None]
    return covered
