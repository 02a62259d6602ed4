"""The paper's grid, flown with rendered captures: every altitude and policy in three densities, over a street in each.

Each density has a street, defects and traffic of its own, so that the same images cover as many defects as possible.
Missions are kept as folders, which `pavetwin sensor fit` reads.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pavetwin.capture.mission_images import MissionImages
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Engine, Listener
from pavetwin.experiments.fly_unit import fly_unit
from pavetwin.experiments.run import run
from pavetwin.experiments.units import Cell, Plan, Unit
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import save_mission
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.store import save_world

DENSITIES: Final = ("low", "medium", "high")

SEGMENT_M: Final = 40.0
"""Longest segment: the damage is that of a whole one, so that an image shows more defects."""


FIRST_SEED: Final = 11
"""Of the first density; each has its own, so that streets, defects and traffic differ."""

STUDY: Final[dict[str, Any]] = {
    "altitudes_m": [6, 10, 15],
    "sensors": ["detector"],
    "presets": ["paper"],
    "set": {"traffic_area_m": 200},
    "replicates": 1,
    "defects": {"population": "paper"},
}


@dataclass(frozen=True)
class Town:
    """A world that is generated, or built of a map."""

    name: str
    source: str
    """`town`, `grid`, `random`, `spider`, or a map's file."""
    seed: int = 0
    parking_rule: str = "europe"


def built(town: Town, folder: Path) -> Path:
    """The folder of a town, built once, without defects: studies place them."""
    target = folder / town.name
    if not (target / "world.yaml").is_file():
        values = {"seed": town.seed, "segment_length_m": SEGMENT_M, "parking_rule": town.parking_rule}
        save_world(build_world(town.source, BuildOptions.parse(values, where=town.name)), target, force=True)
    return target


def town_of(text: str) -> Town:
    """`town:201` as a generated town with this seed; anything else as a map."""
    kind, _, seed = text.partition(":")
    return Town(f"{kind}-{seed}", kind, int(seed)) if seed.isdigit() else Town(Path(text).stem, text)


class Keeping(Engine):
    """Flies in this process, and keeps the folder of every mission."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        listener.on_ready()
        for unit in units:
            listener.on_unit(unit, fly_unit(plan, unit, listener.on_recorded, self._keep))

    def _keep(self, unit: Unit, cell: Cell, result: MissionResult) -> None:
        save_mission(result, self._folder / f"{unit.traffic}-{cell.altitude_m:g}m-{cell.policy}")


def flown(
    town: Path,
    density: str,
    seed: int,
    folder: Path,
    varied: Mapping[str, Any],
    under: Mapping[str, str],
    tell: Callable[[float, str], None],
) -> None:
    """Fly a town's missions in one density, where they were not flown before; their folders are in `folder/TOWN`.

    Args:
        varied: fields of the study's design.
        under: settings of the missions, as a study's `set` names them.
    """
    where = {"worlds": [str(town)], "densities": [density], "seed": seed}
    design = Design.parse({**STUDY, **varied, **where, "set": {**STUDY["set"], **under}}, where="the benchmark")
    altitudes = "-".join(f"{each:g}" for each in design.altitudes_m)
    study = folder.with_name("studies") / folder.name / f"{town.name}-{density}-{altitudes}"
    ran = run(design, study, Keeping(folder / town.name), image_source_factory=MissionImages, on_progress=tell)
    for reason in ran.failures:
        raise PaveTwinError(reason)
