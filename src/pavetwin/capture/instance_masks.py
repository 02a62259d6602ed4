"""The instance image as one mask per label: the pixels that show it and their tight bounding box."""

from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import BoolArray, IndexArray, UInt32Array
from pavetwin.labels.boxes import PixelBox


@dataclass(frozen=True)
class InstanceMask:
    """The visible pixels of one object in one image."""

    label: int
    box: PixelBox
    bits: BoolArray
    """(bottom − top, right − left): which pixels of the box show it. Each edge of the box has at least one."""

    @property
    def area_px(self) -> int:
        return int(self.bits.sum())

    @property
    def sides_px(self) -> tuple[int, int]:
        """The longer and the shorter side of the box."""
        return max(self.bits.shape), min(self.bits.shape)

    def mask(self, size: tuple[int, int]) -> BoolArray:
        """The mask in the whole image (height, width)."""
        mask = np.zeros(size, dtype=np.bool_)
        left, top, right, bottom = self.box
        mask[top:bottom, left:right] = self.bits
        return mask

    def touches_border(self, size: tuple[int, int]) -> bool:
        """Whether it reaches the border of an image (height, width), so that it may be cut off."""
        left, top, right, bottom = self.box
        return left == 0 or top == 0 or right == size[1] or bottom == size[0]


def instance_masks(labels: UInt32Array) -> list[InstanceMask]:
    """One mask for each label of an instance image (height, width), in ascending order; 0 is background."""
    where = np.flatnonzero(labels)
    if not len(where):
        return []
    values = labels.ravel()[where]
    order = np.argsort(values, kind="stable")
    values, where = values[order], where[order]
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    return [
        _instance_mask(int(values[start]), places, labels.shape[1])
        for start, places in zip(starts, np.split(where, starts[1:]), strict=True)
    ]


def _instance_mask(label: int, places: IndexArray, width: int) -> InstanceMask:
    rows, columns = np.divmod(places, width)
    top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
    bits = np.zeros((bottom - top, right - left), dtype=np.bool_)
    bits[rows - top, columns - left] = True
    return InstanceMask(label, (int(left), int(top), int(right), int(bottom)), bits)
