"""Names and numbers of the classes of labels and detections.

Code spells a class as its defect class is registered (`single_crack`), or `person` and `car`. Files for other programs
and images show display names (`Single Crack`). The detector first distinguishes three coarse classes, then the subtypes
of a road defect.
"""

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pavetwin.arrays import IndexArray

SUBTYPES: Final = ("single_crack", "crocodile_crack", "pothole")
"""Subtypes of a road defect, by number; the first classes of label files."""

CRACKS: Final = SUBTYPES[:2]
"""Classes of which a part looks like the whole."""

TRAFFIC: Final = ("person", "car")
"""Objects that are not defects: people, and every motor vehicle."""

CLASSES: Final = (*SUBTYPES, *TRAFFIC)
"""Classes of the detector and of label files, by number."""

COARSE: Final = ("road_defect", *TRAFFIC)
"""Classes of the detection head, by number."""

ROAD_DEFECT: Final = 0
"""Number of the coarse class of every defect."""

NO_SUBTYPE: Final = -1
"""Subtype of a person, of a car, and of a defect of a user's own class, which is detected as a road defect only."""

DISPLAY_NAMES: Final = {
    "single_crack": "Single Crack",
    "crocodile_crack": "Crocodile Crack",
    "pothole": "Pothole",
    "road_defect": "Road Defect",
    "person": "Person",
    "car": "Car",
}
"""Names in label files, tables for other programs, and images."""

SUBTYPE_LABELS: Final = tuple(DISPLAY_NAMES[name] for name in SUBTYPES)
CRACK_LABELS: Final = tuple(DISPLAY_NAMES[name] for name in CRACKS)
CLASS_LABELS: Final = tuple(DISPLAY_NAMES[name] for name in CLASSES)
COARSE_LABELS: Final = tuple(DISPLAY_NAMES[name] for name in COARSE)


def display_name(class_name: str) -> str:
    """The display name of a class; of a user's own class, `Oil Spill` for `oil_spill`."""
    return DISPLAY_NAMES.get(class_name) or class_name.replace("_", " ").title()


def coarse_of(label: str, *, is_defect: bool) -> int | None:
    """The coarse class of a class of label files; None for one that the detector does not know.

    Args:
        label: its display name.
        is_defect: whether the file marks the class as pavement damage.
    """
    if label in SUBTYPE_LABELS or is_defect:
        return ROAD_DEFECT
    return COARSE_LABELS.index(label) if label in COARSE_LABELS else None


def subtype_of(label: str) -> int:
    """The subtype of a class of label files, or `NO_SUBTYPE`."""
    return SUBTYPE_LABELS.index(label) if label in SUBTYPE_LABELS else NO_SUBTYPE


def class_of(coarse: int, subtype: int) -> int | None:
    """The number in `CLASSES`; None for a defect of no known subtype."""
    if coarse == ROAD_DEFECT:
        return subtype if subtype != NO_SUBTYPE else None
    return len(SUBTYPES) + coarse - 1


def coarse_of_classes(numbers: "IndexArray") -> "IndexArray":
    """The coarse classes of numbers in `CLASSES`, of any shape."""
    import numpy as np  # here: every command reads the names

    coarse: IndexArray = np.maximum(ROAD_DEFECT, np.asarray(numbers) - len(SUBTYPES) + 1)
    return coarse
