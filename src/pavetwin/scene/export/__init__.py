"""A world as one file that Blender, game engines and web pages open."""

from pavetwin.scene.export.detail import LEVELS, USUAL, Estimate, level_named
from pavetwin.scene.export.glb_file import ExportSummary, TrafficSnapshot, estimate, export_scene, tiles_of

__all__ = [
    "LEVELS",
    "USUAL",
    "Estimate",
    "ExportSummary",
    "TrafficSnapshot",
    "estimate",
    "export_scene",
    "level_named",
    "tiles_of",
]
