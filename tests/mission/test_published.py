"""The published setup gives the rows that it always gave: the preset `paper` over a world without parking lanes.

`published.csv` holds columns of `mission.parquet` as they were before streets had parking lanes, flown again since
poses of traffic are rounded (decision 69).
"""

from pathlib import Path

import polars as pl
from polars.testing import assert_frame_equal

from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.mission import Traffic
from pavetwin.mission.planning import plan_mission
from pavetwin.mission.saving import segment_table
from pavetwin.world.store import load_world, save_world
from scenes import built

STORED = Path(__file__).parent / "published.csv"
SEED = 2


def flown(folder: Path) -> pl.DataFrame:
    """The rows of the study's altitudes and policies in one recording, in the columns of the stored ones."""
    save_world(
        add_defects(built("cross", parking_rule="none"), DefectOptions(population="paper", per_segment=8)), folder
    )
    world, rows = load_world(folder), []
    traffic: Traffic | None = None
    for altitude_m in (6.0, 10.0, 15.0):
        settings = load_settings("paper", altitude_m=altitude_m)
        ready = prepare(world, settings, world.defects, parking_seed=SEED)
        spec = plan_mission(world, settings, density="low", segments=2, seed=SEED, environment=ready)
        inputs = MissionInputs(ready, traffic) if traffic else load_inputs(spec, world=world, environment=ready)
        traffic = inputs.traffic
        with inputs.replay:
            rows += [
                segment_table(fly(spec.with_policy(policy, settings), inputs=inputs)).with_columns(
                    altitude_m=pl.lit(altitude_m)
                )
                for policy in ("baseline", "hover", "micro", "skip")
            ]
    return pl.concat(rows).select(pl.read_csv(STORED, n_rows=0).columns)


def test_the_rows_of_the_published_setup_stay(tmp_path: Path) -> None:
    rows = flown(tmp_path / "cross")
    stored = pl.read_csv(STORED, schema=rows.schema)
    assert rows["occlusions"].sum() > 0
    assert rows["revisits"].sum() > 0
    assert_frame_equal(rows, stored, rel_tol=0.0, abs_tol=1e-9)
