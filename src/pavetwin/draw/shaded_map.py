"""Maps of a town on which parts of the carriageway are shaded by their condition."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from shapely.geometry.base import BaseGeometry

from pavetwin.draw import shapes, style
from pavetwin.draw.extent import credit, world_bounds
from pavetwin.draw.world_map import MapLayer, draw_world, legend
from pavetwin.world.model import World

_LAYERS: Final = frozenset(
    {MapLayer.PARKS, MapLayer.BUILDINGS, MapLayer.SIDEWALKS, MapLayer.CARRIAGEWAYS, MapLayer.STREET_NAMES}
)
_SHADED: Final = 9.0
"""Above buildings and their shadows, below the names of streets."""


@dataclass(frozen=True, slots=True)
class Shade:
    """One colour of a map and what has it."""

    label: str
    colour: str
    surfaces: Sequence[BaseGeometry]


def save_shaded_map(world: World, shades: Sequence[Shade], *, title: str, subtitle: str, path: Path) -> None:
    """Write the map as a picture, with the shades in its legend in their order.

    Raises:
        PaveTwinError: it cannot be written.
    """
    keys = [style.LegendEntry(shade.label, "patch", shade.colour, style.CASING) for shade in shades]
    with style.styled():
        bounds = world_bounds(world)
        town = [entry for entry in legend(world) if entry.label in ("building", "park, green")]
        figure = style.map_figure(bounds, title=title, subtitle=subtitle, credit=credit(world), legend=[*keys, *town])
        draw_world(figure.axes, world, bounds=bounds, layers=_LAYERS, defects=False, muted=True)
        for shade in shades:
            shapes.fill(figure.axes, list(shade.surfaces), _SHADED, shade.colour, style.CASING, 0.3)
        style.save_figure(figure.figure, path)
