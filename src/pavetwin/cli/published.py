"""Worlds that differ from those of the published study (arXiv 2606.20742), which the preset `paper` flies."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pavetwin.cli.console import out
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.world.model import World

PAPER: Final = "paper"


def note_difference(presets: Iterable[str], worlds: Iterable["World | Path"]) -> None:
    """Say that the preset `paper` is not the published setup over worlds with parking lanes, which of them have any,
    and what to build instead.

    Args:
        worlds: loaded, or their folders; a folder that cannot be read is passed over, since flying over it is refused.
    """
    if PAPER not in presets:
        return
    wider = [name for world in worlds if (name := _name_with_lanes(world))]
    if wider:
        out.line(
            f"Note: the preset {PAPER} is the published setup only over a world without parking lanes. "
            f"{', '.join(wider)} has them, so streets and segments are wider, and results differ. To fly the published "
            "setup, build the world with `pavetwin world build … --parking-rule none`."
        )


def _name_with_lanes(world: "World | Path") -> str | None:
    """The name of a world that has parking lanes."""
    from pavetwin.world.model import LaneKind
    from pavetwin.world.store import load_world

    try:
        loaded = load_world(world) if isinstance(world, Path) else world
    except PaveTwinError:
        return None
    return loaded.name if any(lane.kind is LaneKind.PARKING for lane in loaded.lanes) else None
