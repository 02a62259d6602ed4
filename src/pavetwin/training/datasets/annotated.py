"""An image of the common form: what is labelled in it, and where it is from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.classes import categories

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
    """Those of them that are damage of the pavement."""
    return tuple(category.name for category in categories() if category.supercategory == "defect")


@dataclass(frozen=True, slots=True)
class Annotation:
    """One labelled thing, or a region that is neither an object nor background."""

    category: str | None
    """One of `class_names()`; None for an ignored region, which may hide objects of any class."""
    box: PixelBox
    ignored: str | None = None
    """Why it counts neither as an object nor as background; None for what is labelled."""
    outline: Polygon | None = None
    """Where the source has more than a box."""
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
    """Of its files, without suffix; unique in its dataset."""
    suffix: str
    """Of the picture, with its dot."""
    size_px: tuple[int, int]
    """Width, height."""
    source: str
    """Name of the source."""
    original: str
    """The picture's path in the source's folder, with slashes."""
    group: str
    """Images of one group show the same place; a split keeps them together."""
    gsd_mm: float | None = None
    """Ground resolution: millimetres of the road a pixel covers, where it is known."""
    is_background: bool = False
    """Someone has checked that it shows nothing of any class."""
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
        """The picture's file name."""
        return f"{self.name}{self.suffix}"
