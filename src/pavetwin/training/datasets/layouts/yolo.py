"""YOLO: a text file an image, a line an object: its class's number, then a box or a polygon in shares of the image."""

import re
from collections.abc import Iterator
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import Final, Literal

import yaml
from pydantic import Field

from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox
from pavetwin.training.datasets.layouts.layout import LabelLayout, RawImage, RawObject, paired, unlabelled
from pavetwin.training.datasets.pictures import PictureIndex, files_in
from pavetwin.training.datasets.report import Finding, Report

LARGEST_BYTES: Final = 16 * 2**20  # Largest label file of one image
LARGEST_LIST_BYTES: Final = 2**17  # Largest file of class names: the thousand classes of ImageNet need 43 kB
LONGEST_CLASS: Final = 200  # Characters of a class's name

_NAMES: Final = frozenset({"classes.txt", "obj.names", "_darknet.labels", "readme.txt", "licence.txt", "license.txt"})
"""Text files that are not label files."""

_NAME_TAGS: Final = frozenset({"tag:yaml.org,2002:str", "tag:yaml.org,2002:int"})
"""Types that count as a name; other readers take `no` and `1e3` for something else."""

_LISTS: Final = re.compile(r"(train|val|valid|test|trainval)\.txt", re.IGNORECASE)
"""Lists of pictures, as Darknet has them."""


class YoloLayout(LabelLayout):
    """Boxes (class, middle, width, height) or, with `polygons`, the class and at least three corners."""

    format: Literal["yolo"] = "yolo"
    names: tuple[str, ...] = Field(
        (), description="Classes by number; read from data.yaml or classes.txt if not given."
    )
    polygons: bool = Field(default=False, description="Lines are polygons; each becomes the box around it.")

    def images(self, folder: Path, report: Report) -> Iterator[RawImage]:
        names = self.names or names_in(folder)
        pictures = PictureIndex(folder)
        for labels in files_in(folder, frozenset({".txt"})):
            path = PurePosixPath(labels)
            if path.name.casefold() in _NAMES:
                continue
            if _LISTS.fullmatch(path.name) and not pictures.find(labels, path.stem):
                continue
            picture = paired(pictures, labels, path.stem, report)
            if picture is None:
                continue
            objects = self._objects(folder, labels, names, report)
            if objects is not None:
                yield RawImage(folder / picture, picture, labels, objects, is_normalised=True)
        yield from unlabelled(folder, pictures)

    def _objects(
        self, folder: Path, labels: str, names: tuple[str, ...], report: Report
    ) -> tuple[RawObject, ...] | None:
        """The objects of a label file; None, and a line in the report, where a line of it cannot be read."""
        path, objects = folder / labels, []
        try:
            if path.stat().st_size > LARGEST_BYTES:
                raise ValueError(f"larger than {LARGEST_BYTES >> 20} MiB, which no label file is")
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except (OSError, ValueError) as error:
            words = "is not text" if isinstance(error, UnicodeDecodeError) else str(error)
            if isinstance(error, OSError):
                words = f"cannot be read ({error.strerror})"
            report.add(Finding.REFUSED, labels, f"{words}; the image is left out")
            return None
        for number, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            try:
                objects.append(self._object(line.split(), number, names))
            except ValueError as error:
                report.add(Finding.REFUSED, labels, f"{error}; the image is left out", number)
                return None
        return tuple(objects)

    def _object(self, words: list[str], number: int, names: tuple[str, ...]) -> RawObject:
        """Raises:
        ValueError: it is not an object; the message states the reason.
        """
        is_right = len(words) >= 7 and len(words) % 2 == 1 if self.polygons else len(words) == 5
        if not is_right:
            wanted = "a class and at least three corners" if self.polygons else "a class and four numbers"
            raise ValueError(f"{len(words)} words where {wanted} should be")
        if not re.fullmatch(r"\d{1,6}", words[0], re.ASCII):
            raise ValueError(f"'{words[0]}' is not a class number")
        at = int(words[0])
        if names and at >= len(names):
            raise ValueError(f"class {at} where the dataset has {len(names)}, from 0")
        label = names[at] if names else words[0]
        values = [_number(word) for word in words[1:]]
        if not self.polygons:
            middle_x, middle_y, width, height = values
            box = (middle_x - width / 2, middle_y - height / 2, middle_x + width / 2, middle_y + height / 2)
            return RawObject(label, box, number)
        corners = tuple(zip(values[::2], values[1::2], strict=True))
        return RawObject(label, box_around(corners), number, outline=corners)


def box_around(corners: tuple[tuple[float, float], ...]) -> FloatBox:
    """The smallest box that encloses points."""
    across, down = zip(*corners, strict=True)
    return min(across), min(down), max(across), max(down)


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise ValueError(f"'{word}' is not a number") from None
    if not isfinite(value):
        raise ValueError(f"'{word}' is not a finite number")
    return value


def names_in(folder: Path) -> tuple[str, ...]:
    """The classes that a dataset names itself, in `data.yaml` or `classes.txt`; none where it has neither.

    Raises:
        PaveTwinError: they cannot be read.
    """
    for name in ("data.yaml", "dataset.yaml"):
        if (path := folder / name).is_file():
            return _names_of(path)
    lists = sorted({*folder.rglob("classes.txt"), *folder.rglob("obj.names")})
    if not lists:
        return ()
    lines = _text_of(lists[0]).splitlines()
    names = tuple(line.strip() for line in lines if line.strip())
    for number, name in enumerate(names):
        _check_name(lists[0], number, name)
    return names


def _names_of(path: Path) -> tuple[str, ...]:
    """`names` of a YAML file: a list, or a mapping of the numbers from 0.

    Only their text is read. No values are built of the file, in which aliases may stand for lists of billions.
    """
    try:
        root = yaml.compose(_text_of(path), Loader=yaml.SafeLoader)
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        raise PaveTwinError(f"'{path}' is not YAML that can be read; give `names` in a mapping file.") from error
    keys = root.value if isinstance(root, yaml.MappingNode) else ()
    names = next((value for key, value in keys if key.value == "names"), None)
    if isinstance(names, yaml.SequenceNode):
        found = dict(enumerate(names.value))
    elif isinstance(names, yaml.MappingNode):
        found = {int(key.value) if _is_number(key) else -1: value for key, value in names.value}
    else:
        found = {}
    if not found or set(found) != set(range(len(found))):
        raise PaveTwinError(
            f"'{path}' has no list of classes: `names` must be a list, as in [crack, pothole], or have a class for "
            "every number from 0."
        )
    for number, node in found.items():
        _check_name(path, number, node.value if node.tag in _NAME_TAGS else None)
    return tuple(found[number].value for number in range(len(found)))


def _is_number(key: yaml.Node) -> bool:
    return isinstance(key, yaml.ScalarNode) and re.fullmatch(r"\d{1,6}", key.value, re.ASCII) is not None


def _check_name(path: Path, number: int, name: str | None) -> None:
    """Raises:
    PaveTwinError: it is not a class name.
    """
    if name is None or not 0 < len(name) <= LONGEST_CLASS:
        raise PaveTwinError(
            f"'{path}': class {number} has no name of 1 to {LONGEST_CLASS} characters; put it in quotes where YAML "
            "takes it for something else."
        )


def _text_of(path: Path) -> str:
    """Raises:
    PaveTwinError: it is not text, or larger than a list of classes is.
    """
    try:
        if path.stat().st_size > LARGEST_LIST_BYTES:
            raise PaveTwinError(f"'{path}' is larger than {LARGEST_LIST_BYTES >> 10} KiB, which no list of classes is.")
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise PaveTwinError(f"'{path}' cannot be read as a list of classes.") from error
