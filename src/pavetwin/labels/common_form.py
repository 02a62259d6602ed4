"""The common format of datasets: annotated images, their files on disk, and counts over them.

On disk it is Pascal VOC, with elements `pavetwin` for what VOC cannot express; VOC readers skip these.
`Annotations/NAME.xml` and `JPEGImages/NAME.jpg`: an image belongs to the dataset once its XML file exists, which is
written last. Boxes count pixels from 1 and include their last. Ignored annotations are `difficult`, which VOC's own
evaluation leaves out; a region without a class has the name `ignored`.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from pavetwin.arrays import BoolArray
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, writing
from pavetwin.labels import outlines
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.classes import categories
from pavetwin.labels.voc import ANNOTATIONS, Element, VocObject, XmlError, parse_xml, voc_file

Polygon = tuple[tuple[float, float], ...]
"""Corners (column, row) in pixels of the image, whose first pixel reaches from 0 to 1, as in boxes; none is repeated at
the end. By the even-odd rule."""


def class_names() -> tuple[str, ...]:
    """The classes of the common form, by number: the five of a detector, then one's own classes of defects."""
    return _class_names(tuple(DEFECT_CLASSES.names()))


@lru_cache(maxsize=4)
def _class_names(defects: tuple[str, ...]) -> tuple[str, ...]:
    """Kept until another class of defects is registered: every annotation asks."""
    del defects
    return tuple(category.name for category in categories())


def defect_names() -> tuple[str, ...]:
    """Names of the classes that are pavement damage."""
    return tuple(category.name for category in categories() if category.supercategory == "defect")


@dataclass(frozen=True, slots=True)
class Annotation:
    """One labelled thing, or a region that is neither an object nor background."""

    category: str | None
    """One of `class_names()`; None for an ignored region, which may hide objects of any class."""
    box: PixelBox
    ignored: str | None = None
    """Reason to ignore it: neither an object nor background. None for a label."""
    outline: Polygon | None = None
    """None if the source has only a box."""
    original: str = ""
    """The class as the source names it."""
    attributes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.category is None and self.ignored is None:
            raise ValueError("an annotation without a class must be ignored")
        if self.category is not None and self.category not in class_names():
            raise ValueError(f"'{self.category}' is not a class of the common form")


@dataclass(frozen=True, slots=True)
class AnnotatedImage:
    """One image and its annotations."""

    name: str
    """Name of its files, without suffix; unique in its dataset."""
    suffix: str
    """Suffix of the image file, with its dot."""
    size_px: tuple[int, int]
    """Width, height."""
    source: str
    """Name of the source."""
    original: str
    """Path of the image in the source's folder, with slashes."""
    group: str
    """Images of one group show the same place; a split keeps them together."""
    gsd_mm: float | None = None
    """Ground resolution: millimetres of the road a pixel covers, where it is known."""
    is_background: bool = False
    """Whether it is verified to show no object of any class."""
    annotations: tuple[Annotation, ...] = ()
    attributes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        width, height = self.size_px
        for each in self.annotations:
            left, top, right, bottom = each.box
            if not (0 <= left < right <= width and 0 <= top < bottom <= height):
                raise ValueError(f"box {each.box} of '{self.name}' is not within {width} × {height}")
        if self.is_background and self.labelled:
            raise ValueError(f"'{self.name}' is verified background and has labels")

    @property
    def labelled(self) -> tuple[Annotation, ...]:
        return tuple(each for each in self.annotations if each.ignored is None)

    @property
    def picture(self) -> str:
        """Name of the image file."""
        return f"{self.name}{self.suffix}"


DESCRIPTION: Final = "dataset.yaml"
NO_CLASS: Final = "ignored"


def annotation_path(folder: Path, name: str) -> Path:
    return folder / ANNOTATIONS / f"{name}.xml"


def as_xml(image: AnnotatedImage) -> bytes:
    """The content of an image's file."""
    objects = (
        VocObject(
            each.category or NO_CLASS,
            each.box,
            difficult=each.ignored is not None,
            details={
                "original": each.original or None,
                "ignored": each.ignored,
                "outline": None if each.outline is None else " ".join(f"{x:.2f},{y:.2f}" for x, y in each.outline),
            },
            attributes=each.attributes,
        )
        for each in image.annotations
    )
    return voc_file(
        image.picture,
        image.size_px,
        {"database": image.source, "image": image.original},
        objects,
        details={"group": image.group, "gsd_mm": image.gsd_mm, "background": 1 if image.is_background else None},
        attributes=image.attributes,
    )


def read_image(path: Path) -> AnnotatedImage:
    """An image's file read back.

    Raises:
        PaveTwinError: it is damaged.
    """
    try:
        return _image(parse_xml(path), path.stem)
    except (XmlError, ValueError, TypeError, AttributeError) as error:
        raise PaveTwinError(f"'{path}' is damaged ({error}); make the dataset again.") from error


def _image(root: Element, name: str) -> AnnotatedImage:
    size, source, extra = (_child(root, tag) for tag in ("size", "source", "pavetwin"))
    gsd_mm = extra.value("gsd_mm")
    return AnnotatedImage(
        name=name,
        suffix=Path(_text(root, "filename")).suffix,
        size_px=(int(_text(size, "width")), int(_text(size, "height"))),
        source=_text(source, "database"),
        original=_text(source, "image"),
        group=_text(extra, "group"),
        gsd_mm=float(gsd_mm) if gsd_mm is not None else None,
        is_background=extra.value("background") == "1",
        annotations=tuple(_annotation(each) for each in root.all("object")),
        attributes=_attributes_of(extra),
    )


def _annotation(node: Element) -> Annotation:
    corners, extra, name = _child(node, "bndbox"), _child(node, "pavetwin"), _text(node, "name")
    left, top, right, bottom = (int(_text(corners, tag)) for tag in ("xmin", "ymin", "xmax", "ymax"))
    outline = extra.value("outline")
    return Annotation(
        category=None if name == NO_CLASS else name,
        box=(left - 1, top - 1, right, bottom),
        ignored=extra.value("ignored"),
        outline=_corners(outline) if outline is not None else None,
        original=extra.value("original") or "",
        attributes=_attributes_of(extra),
    )


def _corners(text: str) -> Polygon:
    pairs = (pair.split(",") for pair in text.split())
    return tuple((float(x), float(y)) for x, y in pairs)


def _attributes_of(node: Element) -> dict[str, str]:
    return {_text(each, "name"): each.value("value") or "" for each in node.all("attribute")}


def _child(node: Element, tag: str) -> Element:
    child = node.find(tag)
    if child is None:
        raise ValueError(f"{node.tag} has no {tag}")
    return child


def _text(node: Element, tag: str) -> str:
    value = node.value(tag)
    if value is None:
        raise ValueError(f"{node.tag} has no {tag}")
    return value


def image_names(folder: Path) -> list[str]:
    """The names of a dataset's images, sorted."""
    return sorted(path.stem for path in (folder / ANNOTATIONS).glob("*.xml"))


def read_images(folder: Path) -> Iterator[AnnotatedImage]:
    """The images of a dataset by name, one in memory at a time."""
    for name in image_names(folder):
        yield read_image(annotation_path(folder, name))


def write_description(folder: Path, content: Mapping[str, Any], name: str = DESCRIPTION) -> None:
    """Write `dataset.yaml`, or a file of another name: what made the dataset, its classes, whether it is complete."""
    whole = {"format": FORMAT, "classes": list(class_names()), **content}
    with writing(folder / name) as temporary:
        temporary.write_text(yaml.safe_dump(whole, sort_keys=False, allow_unicode=True), encoding="utf-8")


def read_description(folder: Path, name: str = DESCRIPTION) -> dict[str, Any]:
    """Content of `dataset.yaml`, or of such a file under another name.

    Raises:
        PaveTwinError: the file is missing, damaged, or of another version of the format.
    """
    path = folder / name
    if not path.is_file():
        raise PaveTwinError(f"'{folder}' holds no dataset; make one with `pavetwin data import SOURCE FOLDER`.")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        number = content["format"]
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError) as error:
        raise PaveTwinError(f"'{path}' is damaged; make the dataset again.") from error
    check_format(number, f"'{path}'")
    return dict(content)


ALL = "all"
"""The row of sums."""


@dataclass
class DatasetCounts:
    """Counts by source."""

    instances: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labelled objects by source and class."""
    ignored: Counter[str] = field(default_factory=Counter)
    """Ignored annotations by source."""
    annotated: Counter[str] = field(default_factory=Counter)
    """Images with a label, by source."""
    background: Counter[str] = field(default_factory=Counter)
    """Verified images without any, by source."""
    groups: dict[str, set[str]] = field(default_factory=dict)
    """Scenes by source."""

    def add(self, image: AnnotatedImage) -> None:
        self.annotated[image.source] += bool(image.labelled)
        self.background[image.source] += not image.labelled
        self.groups.setdefault(image.source, set()).add(image.group)
        for each in image.annotations:
            if each.ignored is not None:
                self.ignored[image.source] += 1
            elif each.category is not None:
                self.instances[image.source, each.category] += 1

    @property
    def sources(self) -> list[str]:
        return sorted(self.groups)

    def of_class(self, category: str) -> int:
        """Instances of a class over all sources."""
        return sum(self.instances[source, category] for source in self.sources)


def count_images(images: Iterable[AnnotatedImage]) -> DatasetCounts:
    """The counts of images, one in memory at a time."""
    counts = DatasetCounts()
    for image in images:
        counts.add(image)
    return counts


def filled(annotation: Annotation, size_px: tuple[int, int]) -> BoolArray:
    """Mask (height, width) of an annotation: its outline, or its box if the outline is too thin for a pixel."""
    if annotation.outline is not None:
        within = outlines.filled(np.array(annotation.outline), size_px)
        if within.any():
            return within
    mask = np.zeros(size_px[::-1], dtype=np.bool_)
    left, top, right, bottom = annotation.box
    mask[top:bottom, left:right] = True
    return mask
