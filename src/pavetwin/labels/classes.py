"""The categories of labels: colours, and the size from which an object is labelled."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final

from pavetwin.defects.registry import DEFECT_CLASSES, DefectKind
from pavetwin.labels.class_names import DISPLAY_NAMES, SUBTYPES, display_name


@dataclass(frozen=True, slots=True)
class Category:
    """One class of labels, with the least that must be visible of an object for it to be labelled."""

    number: int
    """From 0, as YOLO counts; COCO's `category_id` is one more."""
    name: str
    supercategory: str
    least_side_px: int
    """Longer side of its box."""
    least_area_px: int
    """Area of its mask."""
    farthest_m: float
    least_short_side_px: int = 1
    """Shorter side of its box: flatter objects are lines at the horizon."""
    least_contrast: float = 0.0
    """Contrast of a defect (`capture.contrast`): a fainter one is ignored."""


_NEAR_M, _FAR_M = 30.0, 80.0
"""Defects are detected on the road ahead; people and vehicles must be detected from farther away."""

_COLOURS: Final = ("#56B4E9", "#E69F00", "#F0577A", "#F7E35A", "#3DDC97")
_MORE_COLOURS: Final = ("#B388EB", "#8CD17D", "#F1CE63", "#FF9DA7", "#76B7B2", "#D4A6C8")
"""Colours of the classes after the first five, in turn."""


def colours(names: Sequence[str]) -> dict[str, str]:
    """The colours of a dataset's classes, given by name in the order of their numbers."""
    more = (_MORE_COLOURS[at % len(_MORE_COLOURS)] for at in range(len(names)))
    return dict(zip(names, (*_COLOURS, *more), strict=False))


PERSON: Final = Category(3, DISPLAY_NAMES["person"], "traffic", 8, 20, _FAR_M)
CAR: Final = Category(4, DISPLAY_NAMES["car"], "traffic", 12, 60, _FAR_M)
"""Every motor vehicle: cars, vans, trucks, buses, and motorcycles. A motorcycle's rider is part of it, not a person."""


def categories() -> tuple[Category, ...]:
    """All categories by number: the three defects, person and car, then other registered defects by name.

    Numbers in files so keep their meaning when a class is added. A dataset's `capture.yaml` holds its own.
    """
    kinds = {kind.name: kind for kind in DEFECT_CLASSES.values()}
    later = sorted(kinds.keys() - set(SUBTYPES))
    first = [_defect(number, kinds[name]) for number, name in enumerate(SUBTYPES)]
    return (*first, PERSON, CAR, *(_defect(number, kinds[name]) for number, name in enumerate(later, CAR.number + 1)))


def category_colours() -> dict[str, str]:
    """The colour of each of the categories, by name."""
    return colours([category.name for category in categories()])


def category_of_defect(kind: str) -> Category:
    """The category of a class of defects.

    Raises:
        PaveTwinError: the class is not known; its file is needed.
    """
    name = display_name(DEFECT_CLASSES.get(kind).name)
    return next(category for category in categories() if category.name == name)


def category_of_agent(*, is_pedestrian: bool) -> Category:
    return PERSON if is_pedestrian else CAR


def _defect(number: int, kind: DefectKind) -> Category:
    return Category(number, display_name(kind.name), "defect", farthest_m=_NEAR_M, **asdict(kind.label))
