"""A labelled image, and a set of them."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.rle import decode
from pavetwin.perception.classes import COARSE, ROAD_DEFECT, SUBTYPES

SPLITS_USED: Final = ("train", "val")
"""Of a dataset, in training."""


@dataclass(frozen=True, slots=True)
class RunLengths:
    """A mask as COCO's compressed run lengths."""

    counts: str
    size: tuple[int, int]
    """Height, width."""
    origin: tuple[int, int] = (0, 0)
    """Column and row of the image at which the mask begins."""


@dataclass(frozen=True, slots=True)
class Outline:
    """A mask as polygons, filled by the even-odd rule."""

    rings: tuple[tuple[float, ...], ...]
    """Each column, row, column, row, … in pixels of the image."""


Shape = RunLengths | Outline
"""A mask as files have it; its pixels are made when they are needed."""


def mask_in(shape: Shape, window: tuple[int, int, int, int]) -> UInt8Array:
    """The pixels of a mask in a window (left, top, right, bottom) of its image: 0 or 255, (height, width)."""
    left, top, right, bottom = window
    if isinstance(shape, Outline):
        canvas = Image.new("L", (right - left, bottom - top))
        pen = ImageDraw.Draw(canvas)
        for ring in shape.rings:
            corners = [(x - left, y - top) for x, y in zip(ring[::2], ring[1::2], strict=True)]
            pen.polygon(corners, fill=255, outline=255)
        return np.asarray(canvas)
    found = np.zeros((bottom - top, right - left), dtype=np.uint8)
    mask = decode(shape.counts, shape.size)
    x, y = shape.origin
    columns = slice(max(left, x), min(right, x + shape.size[1]))
    rows = slice(max(top, y), min(bottom, y + shape.size[0]))
    if columns.start < columns.stop and rows.start < rows.stop:
        part = mask[rows.start - y : rows.stop - y, columns.start - x : columns.stop - x]
        found[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = 255 * part
    return found


@dataclass(frozen=True, slots=True)
class TrueObject:
    """One labelled thing, or a region that is neither an object nor background."""

    category: str
    """As the file names it."""
    coarse: int
    """In `COARSE`."""
    subtype: int
    """In `SUBTYPES`, or `NO_SUBTYPE`."""
    box: FloatBox
    """In pixels of the image."""
    is_ignored: bool = False
    shape: Shape | None = None
    is_pasted: bool = False
    """Whether it was put into the image, which says nothing of others of its class there."""


@dataclass(frozen=True, slots=True)
class Example:
    """A labelled image."""

    name: str
    split: str
    size_px: tuple[int, int]
    """Width, height."""
    source: str
    """Images of one source are labelled by the same rules."""
    is_synthetic: bool
    place: tuple[int, int] | str
    """Where its picture is: offset and length in a packed file, or a path below the folder."""
    gsd_mm: float | None = None
    """Millimetres of the road that a pixel covers, where it is known."""
    objects: tuple[TrueObject, ...] = ()
    is_from_road: bool = False
    """Whether it is known to be taken from a vehicle on the road: then it has a top and a bottom."""


@dataclass(frozen=True)
class ExampleSet:
    """The examples of one dataset."""

    path: Path
    fingerprint: str
    """Of the labels, the same on every machine."""
    examples: tuple[Example, ...]

    def encoded(self, example: Example) -> bytes:
        """The picture's file.

        Raises:
            PaveTwinError: it cannot be read.
        """
        try:
            if isinstance(example.place, str):
                return (self.path / example.place).read_bytes()
            offset, length = example.place
            with self.path.open("rb") as file:
                file.seek(offset)
                return file.read(length)
        except OSError as error:
            raise PaveTwinError(f"The picture of '{example.name}' in '{self.path}' cannot be read: {error}.") from error

    def picture(self, example: Example) -> Image.Image:
        """The picture, in RGB.

        Raises:
            PaveTwinError: it cannot be read, or is not as large as its labels say.
        """
        try:
            picture = Image.open(BytesIO(self.encoded(example))).convert("RGB")
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise PaveTwinError(f"The picture '{example.name}' of '{self.path}' cannot be read: {error}.") from error
        if picture.size != example.size_px:
            told, found = (f"{width} × {height}" for width, height in (example.size_px, picture.size))
            raise PaveTwinError(f"The picture '{example.name}' of '{self.path}' is {found}, and its labels say {told}.")
        return picture


def labelled_classes(examples: Iterable[Example]) -> dict[str, frozenset[int]]:
    """Source → the coarse classes of which it labels any; of others, its images may show some unlabelled.

    Objects that were put into an image are labelled whatever the source labels, so they do not count.
    """
    found: dict[str, set[int]] = defaultdict(set)
    for example in examples:
        found[example.source].update(
            each.coarse for each in example.objects if not each.is_ignored and not each.is_pasted
        )
    return {source: frozenset(classes) for source, classes in found.items()}


def missing_classes(examples: Iterable[Example]) -> list[str]:
    """Coarse classes and subtypes of which no image labels any, by name."""
    objects = [each for example in examples for each in example.objects if not each.is_ignored]
    coarse = {each.coarse for each in objects}
    subtypes = {each.subtype for each in objects}
    missing = [name for at, name in enumerate(SUBTYPES) if at not in subtypes]
    return missing + [name for at, name in enumerate(COARSE) if at not in coarse and at != ROAD_DEFECT]
