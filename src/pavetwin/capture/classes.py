"""The classes a detector learns, and the size from which each is labelled."""

from dataclasses import dataclass
from typing import Final

from pavetwin.defects.registry import kinds
from pavetwin.world.model import DefectClass


@dataclass(frozen=True, slots=True)
class Category:
    """One class of labels, with the least that must be visible of an object for it to be labelled."""

    number: int
    """From 0, as YOLO counts; COCO's `category_id` is one more."""
    name: str
    supercategory: str
    colour: str
    """Of its boxes in contact sheets."""
    least_side_px: int
    """Of the longer side of its box."""
    least_area_px: int
    """Of its mask."""
    farthest_m: float
    least_short_side_px: int = 1
    """Of the shorter side of its box: what is flatter is a line at the horizon."""
    least_contrast: float = 0.0
    """Of a defect (`capture.contrast`): a fainter one is ignored."""


_NEAR_M, _FAR_M = 30.0, 80.0
"""Defects are detected on the road ahead; people and vehicles must be detected from farther away."""

_COLOURS: Final = {
    DefectClass.SINGLE_CRACK: "#56B4E9",
    DefectClass.CROCODILE_CRACK: "#E69F00",
    DefectClass.POTHOLE: "#F0577A",
}
_MORE_COLOURS: Final = ("#B388EB", "#8CD17D", "#F1CE63")

_FIRST: Final = (DefectClass.SINGLE_CRACK, DefectClass.CROCODILE_CRACK, DefectClass.POTHOLE)

PERSON: Final = Category(3, "Person", "traffic", "#F7E35A", 8, 20, _FAR_M)
CAR: Final = Category(4, "Car", "traffic", "#3DDC97", 12, 60, _FAR_M)
"""Every motor vehicle: cars, vans, trucks, buses, and a motorcycle with its rider, who is no Person beside it."""


def categories() -> tuple[Category, ...]:
    """All of them, by number: the three defects, Person and Car, then other registered defects, by name,
    so that numbers in files do not change their meaning when a class is added."""
    later = sorted(kind.name for kind in kinds() if kind.name not in _FIRST)
    first = tuple(_defect(number, kind) for number, kind in enumerate(_FIRST))
    return (*first, PERSON, CAR, *(_defect(CAR.number + 1 + number, kind) for number, kind in enumerate(later)))


def category_named(name: str) -> Category:
    """The category of that name, as it stands in label files.

    Raises:
        KeyError: there is none.
    """
    return {category.name: category for category in categories()}[name]


def category_of_defect(kind: DefectClass) -> Category:
    return category_named(_name(kind))


def category_of_agent(*, is_pedestrian: bool) -> Category:
    return PERSON if is_pedestrian else CAR


def _defect(number: int, kind: DefectClass) -> Category:
    colour = _COLOURS.get(kind, _MORE_COLOURS[number % len(_MORE_COLOURS)])
    # A crack is a line: it must be long enough, though it covers few pixels. A line is detected sooner than a patch.
    # A crack network must show at least a block or two.
    side, short, area, contrast = {
        DefectClass.SINGLE_CRACK: (16, 2, 8, 10.0),
        DefectClass.CROCODILE_CRACK: (8, 8, 20, 17.0),
    }.get(kind, (8, 4, 20, 15.0))
    return Category(number, _name(kind), "defect", colour, side, area, _NEAR_M, short, contrast)


def _name(kind: DefectClass) -> str:
    return kind.value.replace("_", " ").title()
