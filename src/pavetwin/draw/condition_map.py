"""The map of a world's true condition: segments shaded by how many defects they have."""

from itertools import pairwise
from pathlib import Path
from typing import Final

from pavetwin.draw.shaded_map import Shade, save_shaded_map
from pavetwin.world.condition import condition_of
from pavetwin.world.model import World

STEPS: Final = (1.0, 2.0, 4.0, 8.0)
"""Limits between the shades, in defects per 100 m²; each is twice the one before, since densities are lognormal."""

COLOURS: Final = ("#F6E8C8", "#F0C27B", "#E08E45", "#BF4E30", "#7A1F2B")
"""From sound to worn."""


def save_condition_map(world: World, path: Path) -> None:
    """Write the map as a picture.

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
        for number, (range_, colour) in enumerate(zip([*words, f"{STEPS[-1]:g} and more"], COLOURS, strict=True))
    ]
    about = f"{len(world.defects)} defects, {100 * len(world.defects) / area_m2:.1f} per 100 m² on average"
    save_shaded_map(world, shades, title=f"{world.name}: condition", subtitle=about, path=path)


def shade_of(per_100_m2: float) -> int:
    """The number of its shade, from 0 for sound."""
    return sum(per_100_m2 >= limit for limit in STEPS)
