"""Defects: heightfields of the registered classes, what is derived from them, placement, sample points."""

from pavetwin.defects.heightfield import DefectMesh, Heightfield, Marking, Stains, mesh_of
from pavetwin.defects.maps import albedo_factor, lost_surface, normal_map, occlusion_map
from pavetwin.defects.measures import Measures, measure, sample_points
from pavetwin.defects.placement import DefectOptions, add_defects, place, placed_on
from pavetwin.defects.registry import DEFECT_CLASSES, DefectKind, LabelRule, defect_class, heightfield_of, kinds

__all__ = [
    "DEFECT_CLASSES",
    "DefectKind",
    "DefectMesh",
    "DefectOptions",
    "Heightfield",
    "LabelRule",
    "Marking",
    "Measures",
    "Stains",
    "add_defects",
    "albedo_factor",
    "defect_class",
    "heightfield_of",
    "kinds",
    "lost_surface",
    "measure",
    "mesh_of",
    "normal_map",
    "occlusion_map",
    "place",
    "placed_on",
    "sample_points",
]
