"""Maps of a town with the carriageway shaded by its condition: density of defects, or condition index."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from shapely.geometry.base import BaseGeometry

from pavetwin.draw import shapes, style
from pavetwin.draw.extent import credit, world_bounds
from pavetwin.draw.world_map import MapLayer, draw_world, legend
from pavetwin.pci import UnitCondition
from pavetwin.pci.index import RATINGS, Rating
from pavetwin.world.condition import condition_of
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
    """Write the map as an image, with the shades in its legend in their order.

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


STEPS: Final = (1.0, 2.0, 4.0, 8.0)
"""Limits between the shades, in defects per 100 m²; each is twice the one before, since densities are lognormal."""

DENSITY_COLOURS: Final = ("#F6E8C8", "#F0C27B", "#E08E45", "#BF4E30", "#7A1F2B")
"""From sound to worn."""


def save_condition_map(world: World, path: Path) -> None:
    """Write the map as an image.

    Raises:
        PaveTwinError: it cannot be written.
    """
    conditions = condition_of(world)
    area_m2 = sum(segment.area_m2 for segment in world.segments)
    words = [f"below {STEPS[0]:g}", *(f"{low:g} to {high:g}" for low, high in pairwise(STEPS))]
    shades = [
        Shade(
            f"{range_} per 100 m²",
            colour,
            [each.segment.polygon for each in conditions if shade_of(each.per_100_m2) == number],
        )
        for number, (range_, colour) in enumerate(
            zip([*words, f"{STEPS[-1]:g} and more"], DENSITY_COLOURS, strict=True)
        )
    ]
    about = f"{len(world.defects)} defects, {100 * len(world.defects) / area_m2:.1f} per 100 m² on average"
    save_shaded_map(world, shades, title=f"{world.name}: condition", subtitle=about, path=path)


def shade_of(per_100_m2: float) -> int:
    """Number of the shade, 0 for defect-free."""
    return sum(per_100_m2 >= limit for limit in STEPS)


RATING_COLOURS: Final = {
    Rating.GOOD: "#2F7D4F",
    Rating.SATISFACTORY: "#8DBF6A",
    Rating.FAIR: "#F3DC7A",
    Rating.POOR: "#EFA14B",
    Rating.VERY_POOR: "#D9602E",
    Rating.SERIOUS: "#A52A2A",
    Rating.FAILED: "#5B4A57",
}
"""After the standard's scale, from green to dark."""


def save_pci_map(world: World, conditions: Sequence[UnitCondition], path: Path, *, subtitle: str) -> None:
    """Write the map as an image.

    Raises:
        PaveTwinError: it cannot be written.
    """
    title = f"{world.name}: Pavement Condition Index"
    save_shaded_map(world, pci_shades(conditions), title=title, subtitle=subtitle, path=path)


def pci_shades(conditions: Sequence[UnitCondition]) -> list[Shade]:
    """One for each rating, the best first."""
    limits = [100.0, *(least for least, _ in RATINGS)]
    return [
        Shade(
            f"{rating.value}, {low:g} to {high:g}",
            RATING_COLOURS[rating],
            [each.unit.polygon for each in conditions if each.rating is rating],
        )
        for (high, low), (_, rating) in zip(pairwise(limits), RATINGS, strict=True)
    ]
