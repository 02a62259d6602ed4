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
    """Say that the preset `paper` is not the published setup over worlds with parking lanes or with other defects than
    the paper's, which of them these are, and what to build instead.

    Args:
        worlds: loaded, or their folders; a folder that cannot be read is passed over, since flying over it is refused.
        population: what a design places defects by; by what those of each world were placed unless given.
    """
    if PAPER not in presets:
        return
    loaded = [world for each in worlds if (world := _loaded(each))]
    wider = [world.name for world in loaded if _has_lanes(world)]
    others = [f"{world.name} ({of})" for world in loaded if (of := population or _population(world)) != PAPER]
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


def _loaded(world: "World | Path") -> "World | None":
    from pavetwin.world.store import load_world

    try:
        return load_world(world) if isinstance(world, Path) else world
    except PaveTwinError:
        return None


def _has_lanes(world: "World") -> bool:
    from pavetwin.world.model import LaneKind

    return any(lane.kind is LaneKind.PARKING for lane in world.lanes)


def _population(world: "World") -> str:
    """What the defects of a world were placed by; the paper's where there is no record of it."""
    from pavetwin.defects import DefectOptions
    from pavetwin.world.store import load_record

    return PAPER if world.folder is None else DefectOptions.of_record(load_record(world.folder)).population
