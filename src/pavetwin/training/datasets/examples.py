"""Labelled images to train and to evaluate with, read from COCO files of `pavetwin capture` and `pavetwin data export`.

`annotations/instances_SPLIT.json`, pictures in `images/SPLIT/`. Annotations with `iscrowd` 1 are ignored. Nothing but
NumPy and Pillow is needed.
"""

import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image, ImageDraw

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.labels import CUT_OUT
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.class_names import COARSE_LABELS, ROAD_DEFECT, SUBTYPE_LABELS, coarse_of, subtype_of
from pavetwin.labels.rle import decode, encode

SPLITS_USED: Final = ("train", "val")
"""Splits of a dataset that training reads."""


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
    """Its name in the file."""
    coarse: int
    """In `COARSE_LABELS`."""
    subtype: int
    """In `SUBTYPE_LABELS`, or `NO_SUBTYPE`."""
    box: FloatBox
    """In pixels of the image."""
    is_ignored: bool = False
    shape: Shape | None = None
    is_pasted: bool = False
    """True for an object pasted into the image: others of its class there may be unlabelled."""


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
    """Place of its picture: offset and length in a packed file, or a path below the folder."""
    gsd_mm: float | None = None
    """Millimetres of the road that a pixel covers, where it is known."""
    objects: tuple[TrueObject, ...] = ()
    is_from_road: bool = False
    """True if it is known to be taken from a vehicle on the road, so that it has a top and a bottom."""


@dataclass(frozen=True)
class ExampleSet:
    """The examples of one dataset."""

    path: Path
    fingerprint: str
    """Hash of the labels, the same on every machine."""
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
            PaveTwinError: it cannot be read, or has another size than its labels state.
        """
        try:
            picture = Image.open(BytesIO(self.encoded(example))).convert("RGB")
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise PaveTwinError(f"The picture '{example.name}' of '{self.path}' cannot be read: {error}.") from error
        if picture.size != example.size_px:
            stated, found = (f"{width} × {height}" for width, height in (example.size_px, picture.size))
            raise PaveTwinError(f"The picture '{example.name}' of '{self.path}' is {found}, not {stated} as labelled.")
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
    missing = [name for at, name in enumerate(SUBTYPE_LABELS) if at not in subtypes]
    return missing + [name for at, name in enumerate(COARSE_LABELS) if at not in coarse and at != ROAD_DEFECT]


SYNTHETIC: Final = "PaveTwin synthetic images"  # Description of a capture in its COCO files
SYNTHETIC_SOURCE: Final = "pavetwin"  # The source of captures within a dataset of many sources
ROAD_PLATFORMS: Final = ("car",)  # Platforms of captures that drive
_OUTSIDE_PX: Final = 1.0  # Labels may reach this far out of an image, by rounding; what does is clipped


def read_coco(folder: Path, splits: tuple[str, ...]) -> ExampleSet:
    """The examples of a folder's splits.

    Raises:
        PaveTwinError: there are no such files, or a label is not as COCO has it; the message names file and annotation.
    """
    paths = {split: folder / "annotations" / f"instances_{split}.json" for split in splits}
    found = {split: path for split, path in paths.items() if path.is_file()}
    if not found:
        raise PaveTwinError(
            f"'{folder}' holds no annotations/instances_{splits[0]}.json; make one with "
            "`pavetwin data export DATASET --output FOLDER --formats coco` or `pavetwin capture`."
        )
    digest, examples = sha256(), []
    for split, path in found.items():
        try:
            text = path.read_bytes()
            content = json.loads(text)
        except (OSError, ValueError) as error:
            raise PaveTwinError(f"'{path}' cannot be read as JSON ({error}).") from error
        digest.update(text)
        examples += _examples(content, path, split)
    return ExampleSet(folder, digest.hexdigest(), tuple(examples))


def _examples(content: Any, path: Path, split: str) -> list[Example]:
    try:
        description = str(content.get("info", {}).get("description", ""))
        kinds = {each["id"]: _kind(each, path) for each in content["categories"]}
        by_image: dict[int, list[dict[str, Any]]] = {_id(image, f"'{path}': image"): [] for image in content["images"]}
        if len(by_image) < len(content["images"]):
            raise PaveTwinError(f"'{path}' has two images of one id.")
        for row in content["annotations"]:
            number, where = _id(row, f"'{path}': annotation"), row["image_id"]
            if where not in by_image:
                raise PaveTwinError(f"'{path}': annotation {number} is of image {where!r}, which is not listed there.")
            by_image[where].append(row)
        return [_example(image, by_image[image["id"]], kinds, path, split, description) for image in content["images"]]
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise PaveTwinError(f"'{path}' is not as COCO has it ({type(error).__name__}: {error}).") from error


def _id(row: dict[str, Any], where: str) -> int:
    number = row.get("id")
    if not isinstance(number, int) or isinstance(number, bool):
        raise PaveTwinError(
            f"{where} '{row.get('file_name', number)}' has the id {number!r}, which is not a whole number."
        )
    return number


Kind = tuple[str, int, int]


def _kind(category: dict[str, Any], path: Path) -> Kind:
    """Name, coarse class and subtype of a category."""
    name = str(category["name"])
    coarse = coarse_of(name, is_defect=category.get("supercategory") == "defect")
    if coarse is None:
        raise PaveTwinError(
            f"'{path}' has a class '{name}', which the detector does not know; map it to one of its own."
        )
    return name, coarse, subtype_of(name)


def _example(
    image: dict[str, Any],
    rows: list[dict[str, Any]],
    kinds: dict[int, Kind],
    path: Path,
    split: str,
    description: str,
) -> Example:
    size = (int(image["width"]), int(image["height"]))
    source = str(image.get("source") or description)
    objects = tuple(_object(row, kinds, size, path) for row in rows)
    return Example(
        name=str(image["file_name"]),
        split=split,
        size_px=size,
        source=source,
        is_synthetic=SYNTHETIC in (source, description) or source == SYNTHETIC_SOURCE,
        place=f"images/{split}/{image['file_name']}",
        gsd_mm=image.get("gsd_mm"),
        objects=objects,
        is_from_road=_platform(image) in ROAD_PLATFORMS,
    )


def _platform(image: dict[str, Any]) -> object:
    """Platform that took the image: under `camera` in captures, under `attributes` in merged datasets."""
    for section in (image.get("camera"), image.get("attributes")):
        if isinstance(section, dict) and "platform" in section:
            return section["platform"]
    return None


def _object(row: dict[str, Any], kinds: dict[int, Kind], size: tuple[int, int], path: Path) -> TrueObject:
    where = f"'{path}': annotation {row.get('id')}"
    if row["category_id"] not in kinds:
        raise PaveTwinError(f"{where} has category {row['category_id']}, which is not listed there.")
    try:
        left, top, width, height = (float(value) for value in row["bbox"])
    except (TypeError, ValueError) as error:
        raise PaveTwinError(
            f"{where} has the box {row['bbox']!r}, which is not left, top, width and height."
        ) from error
    box = (left, top, left + width, top + height)
    name, coarse, subtype = kinds[row["category_id"]]
    shape = _shape(row.get("segmentation"), where)
    attributes = row.get("attributes")
    is_pasted = isinstance(attributes, dict) and CUT_OUT in attributes
    return TrueObject(name, coarse, subtype, _checked(box, size, where), bool(row.get("iscrowd")), shape, is_pasted)


def _checked(box: FloatBox, size: tuple[int, int], where: str) -> FloatBox:
    """The part of a box within its image.

    Raises:
        PaveTwinError: it is empty, not finite, or reaches out of the image.
    """
    width, height = size
    size_text = " × ".join(f"{value:g}" for value in size)
    if not all(map(isfinite, box)) or box[0] >= box[2] or box[1] >= box[3]:
        raise PaveTwinError(f"{where} has a box without area: {_corners(box)}.")
    beyond = max(-box[0], -box[1], box[2] - width, box[3] - height)
    if beyond > _OUTSIDE_PX:
        raise PaveTwinError(f"{where} has a box that reaches out of its image of {size_text}: {_corners(box)}.")
    return max(box[0], 0.0), max(box[1], 0.0), min(box[2], float(width)), min(box[3], float(height))


def _corners(box: FloatBox) -> str:
    return "left {:g}, top {:g}, right {:g}, bottom {:g}".format(*box)


def _shape(segmentation: Any, where: str) -> Shape | None:
    if isinstance(segmentation, list):
        rings = tuple(tuple(float(value) for value in ring) for ring in segmentation if len(ring) >= 6)
        if any(len(ring) % 2 or not all(map(isfinite, ring)) for ring in rings):
            raise PaveTwinError(f"{where} has a polygon that is not pairs of numbers, column and row.")
        return Outline(rings) if rings else None
    if isinstance(segmentation, dict):
        height, width = (int(value) for value in segmentation["size"])
        counts = segmentation["counts"]
        if isinstance(counts, str):
            return RunLengths(counts, (height, width))
        lengths = np.asarray(counts, dtype=np.int64)
        if lengths.min(initial=0) < 0 or lengths.sum() != height * width:
            raise PaveTwinError(f"{where} has run lengths that do not fill its mask.")
        flat = np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)
        return RunLengths(encode(flat.reshape((height, width), order="F")), (height, width))
    return None
