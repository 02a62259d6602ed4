"""COCO: one JSON file for many images, read entry by entry. Masks without a box get the box around them."""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import Any, Final, Literal

import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.datasets.annotated import Polygon
from pavetwin.datasets.layouts.base import LabelLayout, RawImage, RawObject, unlabelled
from pavetwin.datasets.layouts.coco_file import CocoFile, CocoFileError, as_id, coco_file
from pavetwin.datasets.layouts.yolo import box_around
from pavetwin.datasets.pictures import PictureIndex, files_in, inside, is_file
from pavetwin.datasets.report import Finding, Report
from pavetwin.labels.boxes import FloatBox, of_mask
from pavetwin.labels.outlines import outline
from pavetwin.labels.rle import decode

_PLACES: Final = ("", "images", "train", "val", "valid", "test", "train2017", "val2017")
"""Folders beside or above the JSON file in which `file_name`s are looked for."""

LARGEST_MASK_PX: Final = 100_000_000


class CocoLayout(LabelLayout):
    """`iscrowd` objects are ignored, as COCO's own evaluation does."""

    format: Literal["coco"] = "coco"

    def images(self, folder: Path, report: Report) -> Iterator[RawImage]:
        pictures = PictureIndex(folder)
        for labels in files_in(folder, frozenset({".json"})):
            try:
                with coco_file(folder / labels) as content:
                    if content is not None:
                        yield from self._images_of(content, folder, labels, pictures, report)
            except CocoFileError as error:
                report.add(Finding.REFUSED, labels, f"is not JSON ({error})", error.line)
            except (OSError, UnicodeDecodeError, RecursionError) as error:
                report.add(Finding.REFUSED, labels, f"cannot be read ({type(error).__name__})")
        for name in [name for name in pictures.unused if not self.is_picture(name)]:
            del pictures.unused[name]
        yield from unlabelled(folder, pictures)

    def is_picture(self, name: str) -> bool:
        """Whether a file is a picture of the dataset, not a copy for another format."""
        del name
        return True

    def is_background(self, objects: Sequence[RawObject]) -> bool:
        """Whether an image with these objects is known to show nothing of any class."""
        del objects
        return False

    def _images_of(
        self, content: CocoFile, folder: Path, labels: str, pictures: PictureIndex, report: Report
    ) -> Iterator[RawImage]:
        names = {as_id(each.get("id")): str(each.get("name")) for each in content.categories}
        for image, annotations in content.images():
            path = self._picture(folder, labels, str(image.get("file_name")), report)
            if path is None:
                continue
            original = path.relative_to(folder.resolve()).as_posix()
            pictures.unused.pop(original, None)
            try:
                objects = tuple(self._object(one, names) for one in annotations)
            except (ValueError, TypeError, KeyError, IndexError, OverflowError) as error:
                words = str(error) if isinstance(error, ValueError) else "an annotation is not as COCO has it"
                report.add(Finding.REFUSED, labels, f"image '{original}': {words}; the image is left out")
                continue
            known = {"is_background": self.is_background(objects), **self.details(labels, image)}
            yield RawImage(path, original, labels, objects, size_px=_size(image), **known)

    def details(self, labels: str, image: Mapping[str, Any]) -> dict[str, Any]:
        """What else is known of an image: `gsd_mm`, `group`, `attributes` of its RawImage."""
        del labels
        gsd_mm, group = image.get("gsd_mm"), image.get("group")
        is_known = isinstance(gsd_mm, int | float) and 0 < gsd_mm < float("inf")
        return {"gsd_mm": gsd_mm if is_known else None, "group": group if isinstance(group, str) else None}

    def picture_places(self, labels: str) -> tuple[str, ...]:
        """Folders, from the one of the dataset, in which the pictures of a JSON file may lie."""
        path = PurePosixPath(labels)
        split = path.stem.removeprefix("instances_")
        places = (f"images/{split}", split, *_PLACES)
        return tuple((above / place).as_posix() for above in path.parents for place in places)

    def _picture(self, folder: Path, labels: str, name: str, report: Report) -> Path | None:
        """The picture of a name; None, and a line in the report, where it is not there or leads out of the folder."""
        if inside(folder, name) is None:
            report.add(Finding.REFUSED, labels, f"file_name '{name}' leads out of the folder; the image is left out")
            return None
        for place in self.picture_places(labels):
            path = inside(folder, f"{place}/{name}")
            if path is not None and is_file(path):
                return path
        report.add(Finding.NOTE, labels, f"there is no picture '{name}'; left out", alike=f"missing in {labels}")
        return None

    def _object(self, content: dict[str, Any], names: Mapping[object, str]) -> RawObject:
        """Raises:
        ValueError: it has no class or no place; other exceptions where it is not as COCO has it.
        """
        label = names.get(as_id(content["category_id"]))
        if label is None:
            raise ValueError(
                f"annotation {content.get('id')} has category {content['category_id']}, which is not listed"
            )
        shape = _shape(content.get("segmentation"))
        given = content.get("bbox")
        if given is None and shape is None:
            raise ValueError(f"annotation {content.get('id')} has neither bbox nor segmentation")
        if given is not None:
            left, top, width, height = (float(value) for value in given)
            box = (left, top, left + width, top + height)
        else:
            assert shape is not None
            box = shape[0]
        if not all(map(isfinite, box)):
            raise ValueError(f"annotation {content.get('id')} has a box that is not finite")
        return RawObject(
            label,
            box,
            outline=shape[1] if shape is not None else None,
            ignored=self.ignored(content),
            attributes=self.object_details(content),
        )

    def ignored(self, content: Mapping[str, Any]) -> str | None:
        """Why an annotation counts neither as an object nor as background."""
        return "crowd" if content.get("iscrowd") else None

    def object_details(self, content: Mapping[str, Any]) -> dict[str, str]:
        """What else is known of an object."""
        del content
        return {}


def _size(image: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = image.get("width"), image.get("height")
    return (width, height) if isinstance(width, int) and isinstance(height, int) else None


def _shape(segmentation: Any) -> tuple[FloatBox, Polygon | None] | None:
    """The box around a segmentation, and its outline where that is one polygon; None where there is none."""
    if isinstance(segmentation, list) and segmentation:
        parts = [
            tuple((float(x), float(y)) for x, y in zip(part[::2], part[1::2], strict=True)) for part in segmentation
        ]
        around = box_around(tuple(corner for part in parts for corner in part))
        return around, parts[0] if len(parts) == 1 and len(parts[0]) > 2 else None
    if isinstance(segmentation, dict):
        mask = _mask(segmentation)
        if (box := of_mask(mask)) is not None:
            middles = outline(mask) + 0.5
            return box, tuple((float(x), float(y)) for x, y in middles)
    return None


def _mask(runs: Mapping[str, Any]) -> BoolArray:
    height, width = (int(value) for value in runs["size"])
    if not 0 < height * width <= LARGEST_MASK_PX:
        raise ValueError(f"a mask of {width} × {height} pixels; at most {LARGEST_MASK_PX // 10**6} million are read")
    counts = runs["counts"]
    if isinstance(counts, str):
        return decode(counts, (height, width))
    lengths = [int(count) for count in counts]  # of any size: their sum in 64 bits could come round to the right one
    if min(lengths, default=0) < 0 or sum(lengths) != height * width:
        raise ValueError("run lengths do not fill their mask")
    return np.repeat(np.arange(len(lengths)) % 2 == 1, lengths).reshape((height, width), order="F")
