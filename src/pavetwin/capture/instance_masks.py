"""The instance image taken apart: for every label the pixels that show it and their tight box."""

from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import BoolArray, IndexArray, UInt32Array

Box = tuple[int, int, int, int]
"""Left, top, right, bottom in pixels: the right column and the bottom row are the first ones outside."""


@dataclass(frozen=True)
class InstanceMask:
    """What is seen of one thing in one image."""

    label: int
    box: Box
    bits: BoolArray
    """(bottom − top, right − left): which pixels of the box show it. Every edge of the box has one that does."""

    @property
    def area_px(self) -> int:
        return int(self.bits.sum())

    @property
    def longer_side_px(self) -> int:
        return max(self.box[2] - self.box[0], self.box[3] - self.box[1])

    @property
    def shorter_side_px(self) -> int:
        return min(self.box[2] - self.box[0], self.box[3] - self.box[1])

    def mask(self, size: tuple[int, int]) -> BoolArray:
        """In the whole image (height, width)."""
        mask = np.zeros(size, dtype=np.bool_)
        left, top, right, bottom = self.box
        mask[top:bottom, left:right] = self.bits
        return mask

    def touches_border(self, size: tuple[int, int]) -> bool:
        """Whether it reaches the edge of an image (height, width), so that there may be more of it beyond."""
        left, top, right, bottom = self.box
        return left == 0 or top == 0 or right == size[1] or bottom == size[0]


def pieces(labels: UInt32Array) -> list[InstanceMask]:
    """Everything that an instance image (height, width) shows, by rising label; 0 is nothing."""
    where = np.flatnonzero(labels)
    if not len(where):
        return []
    values = labels.ravel()[where]
    order = np.argsort(values, kind="stable")
    values, where = values[order], where[order]
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    return [
        _piece(int(values[start]), places, labels.shape[1])
        for start, places in zip(starts, np.split(where, starts[1:]), strict=True)
    ]


def _piece(label: int, places: IndexArray, width: int) -> InstanceMask:
    rows, columns = np.divmod(places, width)
    top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
    bits = np.zeros((bottom - top, right - left), dtype=np.bool_)
    bits[rows - top, columns - left] = True
    return InstanceMask(label, (int(left), int(top), int(right), int(bottom)), bits)
