"""What stands still: roads, segments, buildings, street furniture; from OSM, from SUMO, or generated."""

from pavetwin.world.build import BuildOptions, Built, build_world
from pavetwin.world.model import Defect, DefectClass, GeoReference, Segment, Severity, World
from pavetwin.world.store import load_world, save_world

__all__ = [
    "BuildOptions",
    "Built",
    "Defect",
    "DefectClass",
    "GeoReference",
    "Segment",
    "Severity",
    "World",
    "build_world",
    "load_world",
    "save_world",
]
