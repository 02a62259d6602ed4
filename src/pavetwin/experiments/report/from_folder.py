"""The study of a folder, as its report shows it."""

from pathlib import Path
from typing import Any

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.report.gather import gather
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.statistics import MissionLimits, Objective
from pavetwin.experiments.store import Store
from pavetwin.world.model import World
from pavetwin.world.store import load_world


def gather_folder(
    store: Store, *, limits: MissionLimits | None = None, objective: Objective = Objective.MOST_FOUND
) -> Study:
    """The statistics of what was flown so far.

    Args:
        limits, objective: of the recommendation.

    Raises:
        PaveTwinError: the folder holds no study, nothing of it is flown, or a file is damaged.
    """
    said, table, design = store.description(), store.table(), store.design()
    return gather(
        design.name, _plain(said), table, _worlds(design), limits=limits, objective=objective, seed=design.seed
    )


def _plain(said: dict[str, Any]) -> dict[str, Any]:
    """The design and the versions it was flown with, as a report shows them."""
    return {
        **said["design"],
        "version": said["versions"]["pavetwin"],
        "files": said.get("files") or {},
        "made_with": {
            "SUMO": said["versions"]["libsumo"],
            **{f"world {name}": content for name, content in said["worlds"].items()},
        },
        "worlds": [
            world if world["routes"] or world["recordings"] or world.get("nearest") else world["path"]
            for world in said["design"]["worlds"]
        ],
    }


def _worlds(design: Design) -> dict[str, World]:
    """Those that can still be read; the others get no map."""
    found = {}
    for entry in design.worlds:
        try:
            world = load_world(Path(entry.path))
        except PaveTwinError:
            continue
        found[world.name] = world
    return found
