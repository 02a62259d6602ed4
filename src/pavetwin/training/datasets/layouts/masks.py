"""Label images: a picture has a mask for each class, whose connected parts become objects.

Thin things are often broken in such masks, so parts nearer to each other than `join_px` are one object. Its box is
that of its own pixels, not of the joined ones.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Final, Literal

import numpy as np
from pydantic import Field
from scipy import ndimage

from pavetwin.arrays import BoolArray, UInt8Array
from pavetwin.training.datasets.layouts.layout import LabelLayout, RawImage, RawObject, unlabelled
from pavetwin.training.datasets.pictures import PictureError, PictureIndex, opened
from pavetwin.training.datasets.report import Finding, Report

HALF: Final = 128  # Pixels from this brightness on, of 255 and in any channel, belong to an object


class MaskLayout(LabelLayout):
    """Files belong together by name: `12_RAW.jpg`, `12_CRACK.png`, `12_POTHOLE.png`."""

    format: Literal["masks"] = "masks"
    picture: str = Field(default="", description="Ending of the names of pictures, before their suffix, such as _RAW.")
    masks: Mapping[str, str] = Field(description="Class → what the names of its masks end in, such as _CRACK.png.")
    join_px: int = Field(default=0, ge=0, le=200, description="Parts with gaps of up to so many pixels are one object.")
    least_px: int = Field(default=1, ge=1, description="Objects with fewer pixels are left out.")

    def images(self, folder: Path, report: Report) -> Iterator[RawImage]:
        pictures = PictureIndex(folder, self.picture)
        endings = tuple(PurePosixPath(ending).stem for ending in self.masks.values())
        for name in list(pictures.unused):
            path = PurePosixPath(name)
            if path.stem.endswith(endings) and not (self.picture and path.stem.endswith(self.picture)):
                pictures.unused.pop(name)  # a mask itself
                continue
            stem = path.stem.removesuffix(self.picture)
            there = {label: str(path.parent / f"{stem}{ending}") for label, ending in self.masks.items()}
            there = {label: mask for label, mask in there.items() if (folder / mask).is_file()}
            if not there:
                continue
            pictures.unused.pop(name)
            try:
                parts = {label: _brightness(folder / mask) for label, mask in there.items()}
            except PictureError as error:
                report.add(Finding.REFUSED, name, f"of a mask: {error}; the image is left out")
                continue
            sizes = {each.shape[::-1] for each in parts.values()}
            if len(sizes) > 1:
                report.add(Finding.REFUSED, name, "its masks are not of one size; the image is left out")
                continue
            for label, brightness in parts.items():
                _report_dark(brightness, there[label], report)
            masks = {label: brightness >= HALF for label, brightness in parts.items()}
            objects = tuple(each for label, mask in masks.items() for each in self._objects(label, mask, name, report))
            yield RawImage(folder / name, name, name, objects, size_px=sizes.pop())
        yield from unlabelled(folder, pictures)

    def _objects(self, label: str, mask: BoolArray, name: str, report: Report) -> Iterator[RawObject]:
        for box, pixels in components(mask, self.join_px):
            if pixels < self.least_px:
                report.add(
                    Finding.DROPPED,
                    name,
                    f"parts of a mask of fewer than {self.least_px} pixels are left out",
                    alike="small parts of masks",
                )
                continue
            yield RawObject(label, box)


def _brightness(path: Path) -> UInt8Array:
    """The brightest channel of each pixel of a mask (height, width).

    Raises:
        PictureError: it cannot be read.
    """
    with opened(path) as picture:
        coloured = picture.convert("RGB")
        brightest: UInt8Array = np.maximum.reduce([np.asarray(coloured.getchannel(band)) for band in "RGB"])
    return brightest


def _report_dark(brightness: UInt8Array, mask: str, report: Report) -> None:
    """Report a mask that is not black and has no bright pixel: often its values are 0 and 1."""
    brightest = int(brightness.max())
    if 0 < brightest < HALF:
        words = f"no pixel of this mask is brighter than {brightest} of 255, and only those from {HALF} on count"
        report.add(
            Finding.NOTE, mask, f"{words}; multiply its values if they are 0 and {brightest}", alike="dark masks"
        )


def components(mask: BoolArray, join_px: int = 0) -> list[tuple[tuple[float, float, float, float], int]]:
    """The box and the number of pixels of each connected part (diagonals connect) of a mask, in order of first row.

    Args:
        join_px: parts with gaps of at most so many pixels, measured along rows, columns or diagonals, are one.
    """
    joined = mask
    if join_px:
        reach = -(-join_px // 2)
        joined = ndimage.maximum_filter(mask, size=2 * reach + 1, mode="constant")
    numbers, _ = ndimage.label(joined, structure=np.ones((3, 3)))
    numbers = np.where(mask, numbers, 0)
    found = []
    for number, place in enumerate(ndimage.find_objects(numbers), start=1):
        if place is not None:
            rows, columns = place
            box = (float(columns.start), float(rows.start), float(columns.stop), float(rows.stop))
            found.append((box, int((numbers[place] == number).sum())))
    return found
