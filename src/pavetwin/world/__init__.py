"""The static world: roads, segments, buildings and street furniture, from OSM, from SUMO, or generated.

Each name is loaded when it is first used, so that a folder can be checked (`world.folder`) before geometry is loaded.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pavetwin.world.build import BuildOptions, Built, build_world
    from pavetwin.world.georeference import GeoReference
    from pavetwin.world.model import Defect, Segment, Severity, World
    from pavetwin.world.store import load_world, save_world

_MODULES = {
    **dict.fromkeys(("BuildOptions", "Built", "build_world"), "build"),
    "GeoReference": "georeference",
    **dict.fromkeys(("Defect", "Segment", "Severity", "World"), "model"),
    **dict.fromkeys(("load_world", "save_world"), "store"),
}

__all__ = [
    "BuildOptions",
    "Built",
    "Defect",
    "GeoReference",
    "Segment",
    "Severity",
    "World",
    "build_world",
    "load_world",
    "save_world",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
