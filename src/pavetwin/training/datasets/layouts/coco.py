"""COCO: one JSON file for many images, read entry by entry, with the line of each. Masks without a box get the box
around them."""

import json
import tempfile
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import IO, Any, Final, Literal

import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.labels.boxes import FloatBox, of_mask
from pavetwin.labels.common_form import Polygon
from pavetwin.labels.outlines import boundary
from pavetwin.labels.rle import decode
from pavetwin.training.datasets.layouts.layout import LabelLayout, RawImage, RawObject, unlabelled
from pavetwin.training.datasets.layouts.yolo import box_around
from pavetwin.training.datasets.pictures import PictureError, PictureIndex, files_in, inside, is_file, picture_size
from pavetwin.training.datasets.report import Finding, Report

CHUNK: Final = 1 << 20  # Characters that are read at a time
LARGEST: Final = 1 << 28  # Characters of one entry, at most

_MOST_OTHERS: Final = 1000

_UNDECIDED: Final = 2  # Characters of a number that it may have beyond a shorter one: `.`, `e+`
MOST_DIGITS: Final = 300  # Most digits of a whole number; a longer one exceeds a float and is read as infinite
LISTS: Final = ("categories", "images", "annotations")  # Lists of a COCO file


class CocoFileError(ValueError):
    """A file is not JSON; the message states the reason."""

    def __init__(self, words: str, line: int) -> None:
        super().__init__(words)
        self.line = line


@dataclass(frozen=True, slots=True)
class CocoEntry:
    """One object of a list of the file."""

    content: dict[str, Any]
    line: int
    """Line where it begins, from 1."""


class CocoFile:
    """The entries of a file that was read once."""

    def __init__(self, entries: IO[bytes]) -> None:
        self._entries = entries
        self.categories: list[dict[str, Any]] = []
        self._images: list[tuple[str, object, int, int]] = []
        """`file_name`, id, where its text begins, and its line."""
        self._annotations: dict[object, array[int]] = {}
        """Offset and line of each annotation, keyed by the id of the image."""
        self.lists: set[str] = set()
        """Members of `LISTS` that the file has."""
        self.others: list[int] = []
        """Lines of the entries of its lists that are not objects; the first thousand."""

    def add(self, key: str, content: Any, text: str, line: int) -> None:
        """Take up an entry of one of the file's lists, its text and its line."""
        if not isinstance(content, dict):
            if len(self.others) < _MOST_OTHERS:
                self.others.append(line)
            return
        if key == "categories":
            self.categories.append(content)
            return
        begins = self._entries.tell()
        self._entries.write(text.encode().replace(b"\n", b" ") + b"\n")
        if key == "images":
            self._images.append((str(content.get("file_name")), as_id(content.get("id")), begins, line))
        else:
            self._annotations.setdefault(as_id(content.get("image_id")), array("q")).extend((begins, line))

    def images(self) -> Iterator[tuple[CocoEntry, list[CocoEntry]]]:
        """Every image with its annotations, by `file_name`, the annotations in the file's order."""
        for _, number, begins, line in sorted(self._images, key=lambda image: image[0]):
            places = self._annotations.get(number, array("q"))
            annotations = [self._entry(*place) for place in zip(places[::2], places[1::2], strict=True)]
            yield self._entry(begins, line), annotations

    def repeated_ids(self) -> frozenset[object]:
        """The ids that several images have, or that are none: whose annotations are whose is not known."""
        counts = Counter(number for _, number, _, _ in self._images)
        return frozenset({None, *(number for number, count in counts.items() if count > 1)})

    def stray_lines(self) -> Iterator[int]:
        """The lines of annotations of images that are not listed."""
        known = {number for _, number, _, _ in self._images}
        for number, places in self._annotations.items():
            if number not in known:
                yield from places[1::2]

    def _entry(self, begins: int, line: int) -> CocoEntry:
        self._entries.seek(begins)
        return CocoEntry(_DECODER.decode(self._entries.readline().decode()), line)


def _whole(digits: str) -> int | float:
    """A whole number; Python reads one of thousands of digits slowly, or refuses to."""
    return int(digits) if len(digits) <= MOST_DIGITS else float(digits)


_DECODER: Final = json.JSONDecoder(parse_int=_whole)


def as_id(value: object) -> object:
    """An id as it may be compared: lists and the like are none."""
    return value if isinstance(value, int | str) and not isinstance(value, bool) else None


@contextmanager
def coco_file(path: Path) -> Iterator[CocoFile | None]:
    """A file's entries while the block runs; None for a JSON file that has none of COCO's lists.

    Raises:
        CocoFileError: it is not JSON.
        OSError, UnicodeDecodeError, RecursionError: it cannot be read.
    """
    with path.open(encoding="utf-8-sig") as stream, tempfile.TemporaryFile() as entries:
        found, scanner = CocoFile(entries), _Scanner(stream)
        for key, entry in scanner.entries():
            if key in LISTS:
                found.lists.add(key)
                if entry is not None:
                    found.add(key, *entry)
        yield found if found.lists else None


class _Scanner:
    """Reads the lists of a JSON object entry by entry."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._text, self._at = "", 0
        self._line, self._counted = 1, 0
        """The line of this place in the text, which is not behind `_at`."""

    def entries(self) -> Iterator[tuple[str, tuple[Any, str, int] | None]]:
        """Every entry of every list as (key, content, text, line); each list begins with its key alone."""
        if self._next() == "[":  # of a list as the whole, no entry is wanted
            for _ in self._list(""):
                pass
        elif self._next() == "{":
            yield from self._lists()
        else:
            self._value()
        if self._next():
            raise self._error("Extra data")

    def _lists(self) -> Iterator[tuple[str, tuple[Any, str, int] | None]]:
        self._take("{")
        while self._next() != "}":
            key, _, _ = self._value()
            self._take(":")
            if self._next() != "[":
                self._value()
            else:
                yield str(key), None
                yield from self._list(str(key))
            if self._next() != "}":
                self._take(",")
        self._take("}")

    def _list(self, key: str) -> Iterator[tuple[str, tuple[Any, str, int]]]:
        self._take("[")
        while self._next() != "]":
            yield key, self._value()
            if self._next() != "]":
                self._take(",")
                if self._next() == "]":
                    raise self._error("Expecting value")
        self._take("]")

    def _next(self) -> str:
        """The next non-space character; empty at the end."""
        while True:
            while self._at < len(self._text) and self._text[self._at].isspace():
                self._at += 1
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._more(CHUNK):
                return ""

    def _take(self, character: str) -> None:
        if self._next() != character:
            raise self._error(f"Expecting '{character}' delimiter")
        self._at += 1

    def _value(self) -> tuple[Any, str, int]:
        """The next value, its text and its line."""
        self._next()
        self._count()
        line, size = self._line, CHUNK
        while True:
            try:
                content, end = _DECODER.raw_decode(self._text, self._at)
            except json.JSONDecodeError as error:
                if not self._more(size):
                    raise self._error(error.msg, error.pos) from error
            else:
                # A number near the end of what was read may go on (`1e+` is read as 1).
                if end + _UNDECIDED < len(self._text) or not self._more(size):
                    text, self._at = self._text[self._at : end], end
                    return content, text, line
            size = min(2 * len(self._text), LARGEST)
            if len(self._text) - self._at > LARGEST:
                raise self._error(f"one entry has more than {LARGEST // 10**6} million characters")

    def _more(self, size: int) -> bool:
        """Read on. Returns whether there was more."""
        chunk = self._stream.read(size)
        if not chunk:
            return False
        self._count()
        self._text, self._at, self._counted = self._text[self._at :] + chunk, 0, 0
        return True

    def _count(self) -> None:
        """Count lines up to where the reader is."""
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at

    def _error(self, words: str, at: int | None = None) -> CocoFileError:
        end = self._at if at is None else at
        return CocoFileError(words, self._line + self._text.count("\n", self._counted, end))


_PLACES: Final = ("", "images", "train", "val", "valid", "test", "train2017", "val2017")
"""Folders next to or above the JSON file that may hold the pictures."""

LARGEST_GSD_MM: Final = 1000.0  # Ground resolution of an image, at most, as of a source (`DatasetSource.gsd_mm`)


class CocoEntryError(ValueError):
    """An entry is not as COCO has it; the message states the reason."""


class CocoLayout(LabelLayout):
    """`iscrowd` objects are ignored, as COCO's own evaluation does."""

    format: Literal["coco"] = "coco"

    def images(self, folder: Path, report: Report) -> Iterator[RawImage]:
        pictures = PictureIndex(folder)
        for labels in files_in(folder, frozenset({".json"})):
            try:
                with coco_file(folder / labels) as content:
                    if content is not None and _is_whole(content, labels, report):
                        yield from self._images_of(content, folder, labels, pictures, report)
            except CocoFileError as error:
                report.add(Finding.REFUSED, labels, f"is not JSON ({error})", error.line)
            except (OSError, UnicodeDecodeError, RecursionError) as error:
                report.add(Finding.REFUSED, labels, f"cannot be read ({type(error).__name__})")
        for name in [name for name in pictures.unused if not self.is_picture(name)]:
            del pictures.unused[name]
        yield from unlabelled(folder, pictures)

    def is_picture(self, name: str) -> bool:
        """Return whether a file is a picture of the dataset, not a copy for another format."""
        del name
        return True

    def is_background(self, objects: Sequence[RawObject]) -> bool:
        """Return whether an image with these objects is verified background."""
        del objects
        return False

    def _images_of(
        self, content: CocoFile, folder: Path, labels: str, pictures: PictureIndex, report: Report
    ) -> Iterator[RawImage]:
        names = {as_id(each.get("id")): str(each.get("name")) for each in content.categories}
        repeated = content.repeated_ids()
        for image, annotations in content.images():
            path = self._picture(folder, labels, image, report)
            if path is None:
                continue
            original = path.relative_to(folder.resolve()).as_posix()
            pictures.unused.pop(original, None)
            if (number := as_id(image.content.get("id"))) in repeated:
                words = "has no id" if number is None else f"has the id {number!r} of another image"
                report.add(Finding.REFUSED, labels, f"image '{original}' {words}; the image is left out", image.line)
                continue
            line, objects, size = image.line, [], lru_cache(maxsize=1)(partial(picture_size, path))
            try:
                for each in annotations:
                    line = each.line
                    objects.append(self._object(each, names, size))
                line = image.line
                known = {"is_background": self.is_background(objects), **self.details(labels, image.content)}
            except (ValueError, TypeError, LookupError, ArithmeticError, AttributeError) as error:
                is_explained = isinstance(error, CocoEntryError | PictureError)
                words = str(error) if is_explained else "an entry is not as COCO has it"
                report.add(Finding.REFUSED, labels, f"image '{original}': {words}; the image is left out", line)
                continue
            if not _is_resolution(known.get("gsd_mm")):
                words = f"image '{original}': gsd_mm is not above 0 and at most {LARGEST_GSD_MM:g}; taken as not known"
                report.add(Finding.NOTE, labels, words, line, alike=f"gsd_mm in {labels}")
                known["gsd_mm"] = None
            yield RawImage(path, original, labels, tuple(objects), size_px=_size(image.content), line=line, **known)

    def details(self, labels: str, image: Mapping[str, Any]) -> dict[str, Any]:
        """Further fields of an image's RawImage: `gsd_mm`, which is checked later, `group`, `attributes`.

        Raises:
            CocoEntryError: something of it cannot be understood.
        """
        del labels
        group = image.get("group")
        return {"gsd_mm": image.get("gsd_mm"), "group": group if isinstance(group, str) else None}

    def picture_places(self, labels: str) -> tuple[str, ...]:
        """Folders, from the one of the dataset, in which the pictures of a JSON file may lie."""
        path = PurePosixPath(labels)
        split = path.stem.removeprefix("instances_")
        places = (f"images/{split}", split, *_PLACES)
        return tuple((above / place).as_posix() for above in path.parents for place in places)

    def _picture(self, folder: Path, labels: str, image: CocoEntry, report: Report) -> Path | None:
        """An image's picture; None, and a line in the report, where it is not there or leads out of the folder."""
        name = str(image.content.get("file_name"))
        if inside(folder, name) is None:
            words = f"file_name '{name}' leads out of the folder; the image is left out"
            report.add(Finding.REFUSED, labels, words, image.line)
            return None
        for place in self.picture_places(labels):
            path = inside(folder, f"{place}/{name}")
            if path is not None and is_file(path):
                return path
        words = f"there is no picture '{name}'; left out"
        report.add(Finding.NOTE, labels, words, image.line, alike=f"missing in {labels}")
        return None

    def _object(self, entry: CocoEntry, names: Mapping[object, str], size: Callable[[], tuple[int, int]]) -> RawObject:
        """Args:
            size: of the picture, width and height.

        Raises:
            CocoEntryError: it has no class or no place; other exceptions where it is not as COCO has it.
        """
        content = entry.content
        which = f"annotation {content.get('id')}"
        category = as_id(content.get("category_id"))
        label = names.get(category)
        if category is None or label is None:
            raise CocoEntryError(f"{which} has category {content.get('category_id')}, which is not listed")
        shape = _shape(content.get("segmentation"), which, size)
        given = content.get("bbox")
        if given is not None:
            box = _box(given, which)
        elif shape is not None:
            box = shape[0]
        else:
            raise CocoEntryError(f"{which} has neither bbox nor segmentation")
        return RawObject(
            label,
            box,
            entry.line,
            outline=shape[1] if shape is not None else None,
            ignored=self.ignored(content),
            attributes=self.object_details(content),
        )

    def ignored(self, content: Mapping[str, Any]) -> str | None:
        """Reason to ignore an annotation, which is then neither an object nor background; None for a label."""
        return "crowd" if content.get("iscrowd") else None

    def object_details(self, content: Mapping[str, Any]) -> dict[str, str]:
        """Attributes of an object."""
        del content
        return {}


def _size(image: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = image.get("width"), image.get("height")
    return (width, height) if isinstance(width, int) and isinstance(height, int) else None


def _is_whole(content: CocoFile, labels: str, report: Report) -> bool:
    """Check that a file has all lists of COCO; report missing lists and unusable entries."""
    if missing := [f"`{key}`" for key in LISTS if key not in content.lists]:
        report.add(Finding.NOTE, labels, f"has no list {' and no list '.join(missing)}, as COCO has; left out")
        return False
    for line in content.others:
        report.add(Finding.REFUSED, labels, "an entry is not an object; left out", line, alike=f"entry of {labels}")
    for line in content.stray_lines():
        words = "an annotation is of an image that is not listed; left out"
        report.add(Finding.NOTE, labels, words, line, alike=f"stray in {labels}")
    return True


def _is_resolution(gsd_mm: object) -> bool:
    """Return whether a value is a ground resolution or absent."""
    if isinstance(gsd_mm, bool):
        return False
    return gsd_mm is None or (isinstance(gsd_mm, int | float) and 0 < gsd_mm <= LARGEST_GSD_MM)


def _numbers(values: Any) -> list[float]:
    """Finite numbers; empty where they are not a list of such."""
    try:
        numbers = [float(value) for value in values] if isinstance(values, list) else []
    except (ValueError, TypeError, OverflowError):
        return []
    return numbers if all(map(isfinite, numbers)) else []


def _box(given: Any, which: str) -> FloatBox:
    """The edges of a `bbox`, which has left, top, width and height."""
    numbers = _numbers(given)
    if len(numbers) != 4:
        raise CocoEntryError(f"the bbox of {which} is not four finite numbers")
    left, top, width, height = numbers
    box = (left, top, left + width, top + height)
    if not all(map(isfinite, box)):
        raise CocoEntryError(f"the bbox of {which} is not four finite numbers")
    return box


def _shape(
    segmentation: Any, which: str, size: Callable[[], tuple[int, int]]
) -> tuple[FloatBox, Polygon | None] | None:
    """The box around a segmentation, and its outline where that is one polygon; None where there is none."""
    if isinstance(segmentation, dict):
        mask = _mask(segmentation, which, size)
        if (box := of_mask(mask)) is None:
            return None
        return box, tuple((x, y) for x, y in boundary(mask).tolist())
    if segmentation is None or segmentation == []:
        return None
    parts = [_numbers(part) for part in segmentation] if isinstance(segmentation, list) else []
    if not parts or not all(parts) or any(len(part) % 2 for part in parts):
        raise CocoEntryError(
            f"the segmentation of {which} is not a list of polygons, each x, y, x, y … in finite numbers"
        )
    polygons = [tuple(zip(part[::2], part[1::2], strict=True)) for part in parts]
    around = box_around(tuple(corner for polygon in polygons for corner in polygon))
    return around, polygons[0] if len(polygons) == 1 and len(polygons[0]) > 2 else None


def _mask(runs: Mapping[str, Any], which: str, size: Callable[[], tuple[int, int]]) -> BoolArray:
    """The mask (height, width) of run lengths, which must have the picture's size before anything is decoded."""
    width, height = size()
    if _numbers(runs.get("size")) != [height, width]:
        raise CocoEntryError(f"the mask of {which} has not the picture's size, {width} × {height} pixels")
    counts: Any = runs.get("counts")
    if isinstance(counts, str):
        try:
            return decode(counts, (height, width))
        except ValueError as error:
            raise CocoEntryError(f"the mask of {which}: {error}") from error
    # Integers of any size: their sum in 64 bits could come round to the right one.
    lengths = [count for count in counts if isinstance(count, int)] if isinstance(counts, list) else []
    if not lengths or len(lengths) != len(counts) or min(lengths) < 0 or sum(lengths) != height * width:
        raise CocoEntryError(f"the run lengths of the mask of {which} do not fill its size")
    return np.repeat(np.arange(len(lengths)) % 2 == 1, lengths).reshape((height, width), order="F")
