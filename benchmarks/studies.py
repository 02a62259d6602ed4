"""The paper's study, 720 segment missions, from nothing and again with its traffic recorded."""

import os
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from unittest.mock import patch

import yaml

from benchmarks.measure import Kind, Line
from pavetwin.experiments.design import Design, placed_at, preset_text
from pavetwin.experiments.engine import Pool, Single
from pavetwin.experiments.run import run
from pavetwin.world.folder import CACHE_VARIABLE

FROM_NOTHING_TARGET_S, RECORDED_TARGET_S = 35.0, 8.0


def lines(world_folder: Path, folder: Path, changes: Mapping[str, Any]) -> Iterator[Line]:
    """Over a copy of a world, with an empty cache, by as many processes as there are cores.

    Args:
        changes: what is not as in the paper's design.
    """
    world = shutil.copytree(world_folder, folder / "studied", ignore=shutil.ignore_patterns("traffic", "navmesh*"))
    processes = os.cpu_count() or 1
    values = yaml.safe_load(preset_text("paper", str(world))) | changes
    design = placed_at(Design.parse(values, where="the paper's design"), folder)
    engine = Single() if processes == 1 else Pool(processes)
    for what, target_s in (("from nothing", FROM_NOTHING_TARGET_S), ("its traffic recorded", RECORDED_TARGET_S)):
        begun = time.perf_counter()
        with patch.dict(os.environ, {CACHE_VARIABLE: str(folder / "studied-cache")}):
            ran = run(design, folder / what, engine)
        took_s = time.perf_counter() - begun
        yield Line(
            f"the paper's study, {what}",
            took_s,
            Kind.SECONDS,
            None if changes else target_s,
            note=f"{ran.missions_flown} missions, {len(ran.plan.units)} recordings, {processes} processes; one run",
        )
