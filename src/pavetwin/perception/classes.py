"""The classes of the detector: three coarse ones are detected, defects are then told apart; files have five."""

from typing import Final

import numpy as np

from pavetwin.arrays import IndexArray

SUBTYPES: Final = ("Single Crack", "Crocodile Crack", "Pothole")
"""What the subtype head tells apart, by number; the first classes of label files."""

SINGLE_CRACK: Final = SUBTYPES.index("Single Crack")
"""The number of the class that is thin and long: it fills little of its box."""

CRACKS: Final = SUBTYPES[:2]
"""Of which a part looks like the whole."""

ROAD_DEFECT, PERSON, CAR = range(3)

COARSE: Final = ("Road Defect", "Person", "Car")
"""What the detection head finds, by number."""

CLASSES: Final = (*SUBTYPES, "Person", "Car")
"""The classes of detections and of label files, by number."""

SIZES: Final = ("area_m2", "length_m", "mean_width_mm", "diameter_mm")
"""What may be measured of a defect, by name with unit, in the order of the columns of tables."""

NO_SUBTYPE: Final = -1
"""Of a person, of a car, and of a defect of a class of the user's own, which is detected as Road Defect only."""


def coarse_of(name: str, *, is_defect: bool) -> int | None:
    """The coarse class of a class of label files; None for one that the detector does not know.

    Args:
        is_defect: whether the file says that the class is damage of the pavement.
    """
    if name in SUBTYPES or is_defect:
        return ROAD_DEFECT
    return COARSE.index(name) if name in COARSE else None


def subtype_of(name: str) -> int:
    """The number of a defect's subtype, or `NO_SUBTYPE`."""
    return SUBTYPES.index(name) if name in SUBTYPES else NO_SUBTYPE


def class_of(coarse: int, subtype: int) -> int | None:
    """The number in `CLASSES`; None for a defect of no known subtype."""
    if coarse == ROAD_DEFECT:
        return subtype if subtype != NO_SUBTYPE else None
    return len(SUBTYPES) + coarse - 1


def coarse_of_classes(numbers: IndexArray) -> IndexArray:
    """The coarse classes of numbers in `CLASSES`, of any shape."""
    coarse: IndexArray = np.maximum(ROAD_DEFECT, np.asarray(numbers) - len(SUBTYPES) + 1)
    return coarse
