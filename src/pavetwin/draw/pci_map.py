"""The map of the Pavement Condition Index: sample units in the colours of their ratings."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from pavetwin.draw.shaded_map import Shade, save_shaded_map
from pavetwin.pci import UnitCondition
from pavetwin.pci.index import RATINGS, Rating
from pavetwin.world.model import World

COLOURS: Final = {
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
    """Write the map as a picture.

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
            COLOURS[rating],
            [each.unit.polygon for each in conditions if each.rating is rating],
        )
        for (high, low), (_, rating) in zip(pairwise(limits), RATINGS, strict=True)
    ]
