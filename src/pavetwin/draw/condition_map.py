"""The map of a world's true condition: segments shaded by how many defects they have."""

from itertools import pairwise
from pathlib import Path
from typing import Final

from pavetwin.draw import shapes, style
from pavetwin.draw.world_map import MapLayer, credit, draw_world, legend, world_bounds
from pavetwin.world.condition import condition_of
from pavetwin.world.model import World

STEPS: Final = (1.0, 2.0, 4.0, 8.0)
"""Limits between the shades, in defects per 100 m²; each is twice the one before, since densities are lognormal."""

COLOURS: Final = ("#F6E8C8", "#F0C27B", "#E08E45", "#BF4E30", "#7A1F2B")
"""From sound to worn."""

_LAYERS: Final = frozenset(
    {MapLayer.PARKS, MapLayer.BUILDINGS, MapLayer.SIDEWALKS, MapLayer.CARRIAGEWAYS, MapLayer.STREET_NAMES}
)
_SHADED: Final = 9.0
"""Above buildings and their shadows, below the names of streets."""


def save_condition_map(world: World, path: Path) -> None:
    """Write the map as a picture.

    Raises:
        PaveTwinError: it cannot be written.
    """
    conditions = condition_of(world)
    area_m2 = sum(segment.area_m2 for segment in world.segments)
    about = f"{len(world.defects)} defects, {100 * len(world.defects) / area_m2:.1f} per 100 m² on average"
    keys = [style.LegendEntry(f"{words} per 100 m²", "patch", colour, style.CASING) for words, colour in _shades()]
    with style.styled():
        bounds = world_bounds(world)
        town = [entry for entry in legend(world) if entry.label in ("building", "park, green")]
        figure = style.map_figure(
            bounds, title=f"{world.name}: condition", subtitle=about, credit=credit(world), legend=[*keys, *town]
        )
        draw_world(figure.axes, world, bounds=bounds, layers=_LAYERS, defects=False, muted=True)
        for number, (_, colour) in enumerate(_shades()):
            chosen = [each.segment.polygon for each in conditions if shade_of(each.per_100_m2) == number]
            shapes.fill(figure.axes, chosen, _SHADED, colour, style.CASING, 0.3)
        style.save_figure(figure.figure, path)


def shade_of(per_100_m2: float) -> int:
    """The number of its shade, from 0 for sound."""
    return sum(per_100_m2 >= limit for limit in STEPS)


def _shades() -> list[tuple[str, str]]:
    words = [f"below {STEPS[0]:g}", *(f"{low:g} to {high:g}" for low, high in pairwise(STEPS))]
    return list(zip([*words, f"{STEPS[-1]:g} and more"], COLOURS, strict=True))
