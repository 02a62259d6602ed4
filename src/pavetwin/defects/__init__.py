"""Defects: outlines of the registered classes, their placement, points on them."""

from pavetwin.defects import crocodile_crack, pothole, single_crack  # noqa: F401  - each registers its class
from pavetwin.defects.placement import DefectOptions, add_defects, place
from pavetwin.defects.registry import DefectKind, kind_of, kinds, register
from pavetwin.defects.sampling import sample_points

__all__ = ["DefectKind", "DefectOptions", "add_defects", "kind_of", "kinds", "place", "register", "sample_points"]
