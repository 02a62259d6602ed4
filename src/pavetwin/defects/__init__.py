"""Defects: heightfields of the registered classes, what is derived from them, placement, sample points."""

from pavetwin.defects import crocodile_crack, pothole, single_crack  # noqa: F401  - each registers its class
from pavetwin.defects.heightfield import Heightfield, Stains
from pavetwin.defects.maps import albedo_factor, normal_map, occlusion_map
from pavetwin.defects.marking import Marking
from pavetwin.defects.measures import Measures, measure
from pavetwin.defects.mesh import DefectMesh, mesh_of
from pavetwin.defects.placement import DefectOptions, add_defects, place
from pavetwin.defects.registry import DefectKind, heightfield_of, kind_of, kinds, register, unregister
from pavetwin.defects.sampling import sample_points

__all__ = [
    "DefectKind",
    "DefectMesh",
    "DefectOptions",
    "Heightfield",
    "Marking",
    "Measures",
    "Stains",
    "add_defects",
    "albedo_factor",
    "heightfield_of",
    "kind_of",
    "kinds",
    "measure",
    "mesh_of",
    "normal_map",
    "occlusion_map",
    "place",
    "register",
    "sample_points",
    "unregister",
]
