"""Worlds that differ from those of the published study (arXiv 2606.20742), which the preset `paper` flies."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pavetwin.cli.console import out
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.world.model import World

PAPER: Final = "paper"
"""Name of the preset, and of the damage population."""


def note_difference(presets: Iterable[str], worlds: Iterable["World | Path"], population: str | None = None) -> None:
    """Print the worlds over which the preset `paper` is not the published setup, since they have parking lanes or other
    defects than the paper's, and the command that builds the published one.

    Args:
        worlds: loaded, or their folders; a folder that cannot be read is passed over, since flying over it is refused.
        population: what a design places defects by; default: the population of each world.
    """
    if PAPER not in presets:
        return
    differing = [each for world in worlds if (each := _setup(world, population))]
    wider = [name for name, has_lanes, _ in differing if has_lanes]
    others = [f"{name} ({of})" for name, _, of in differing if of != PAPER]
    differences = []
    if wider:
        differences.append(f"{', '.join(wider)} has parking lanes, so streets and segments are wider.")
    if others:
        differences.append(f"Defects are of another damage population in {', '.join(others)}.")
    if differences:
        out.line(
            f"Note: the preset {PAPER} is the published setup only over a world without parking lanes and with the "
            f"paper's defects. {' '.join(differences)} Results differ. To fly the published setup, build the world "
            f"with `pavetwin world build … --parking-rule none --damage {PAPER}`."
        )


def _setup(world: "World | Path", population: str | None) -> tuple[str, bool, str] | None:
    """The name of a world, whether it has parking lanes, and the damage population of its defects."""
    from pavetwin.world.layers import lane_kinds
    from pavetwin.world.model import LaneKind

    folder = world if isinstance(world, Path) else world.folder
    try:
        kinds = lane_kinds(world) if isinstance(world, Path) else {lane.kind for lane in world.lanes}
        name = world.absolute().name if isinstance(world, Path) else world.name
        return name, LaneKind.PARKING in kinds, population or _population(folder)
    except PaveTwinError:
        return None


def _population(folder: Path | None) -> str:
    """Damage population of a world; the paper's without a record of it."""
    from pavetwin.defects import DefectOptions
    from pavetwin.world.store import load_record

    return PAPER if folder is None else DefectOptions.of_record(load_record(folder)).population
