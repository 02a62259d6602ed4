"""Settings that only some policies or sensors have: the others are flown once, and stand at every level."""

from pathlib import Path
from typing import Any

import polars as pl
import pytest
import yaml
from polars.testing import assert_frame_equal

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.advice import advise
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Single
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.report.tables import headline_table
from pavetwin.experiments.run import run
from pavetwin.experiments.statistics import MissionLimits, differences, effects
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import cells_of, owners_of
from pavetwin.policies import policy_class
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.report_studies import page_of
from scenes.studies import SMALL, study

MINE = """
from pavetwin.policies import GoOn, Policy

class Mine(Policy):
    name = "mine"  # {}
    reads = frozenset()

    def decide(self, snapshot):
        return GoOn()
"""
WAITS_S = (1.0, 2.0, 8.0)
SET = "wait_s_set"
"""The column of what is swept: `wait_s` is a metric."""


def design(**values: Any) -> Design:
    return Design.parse({"worlds": ["town"], **values}, where="the design")


@pytest.mark.parametrize(
    ("sweep", "owners", "cells"),
    [
        ({"wait_s": [1, 2, 8]}, {"wait_s": ["hover"]}, 3 + 3),
        ({"wait_s": [1, 2, 8], "d_max": [2, 3]}, {"wait_s": ["hover"], "d_max": ["micro"]}, 3 + 2 + 2),
        (
            {"wait_s": [1, 2], "policy.max_wait_s": [9, 60]},
            {"wait_s": ["hover"], "policy.max_wait_s": ["hover"]},
            7,
        ),
        ({"tau_o": [0.5, 0.7]}, {}, 2 * 4),
    ],
)
def test_a_policy_is_flown_once_for_all_values_of_a_setting_it_does_not_read(
    sweep: dict[str, Any], owners: dict[str, list[str]], cells: int
) -> None:
    made = design(sweep=sweep, altitudes_m=[6])
    assert owners_of(made) == owners
    found = cells_of(made, owners_of(made))
    assert len(set(found)) == len(found) == cells
    assert [cell.swept for cell in found if cell.policy == "skip"] == (
        [(None,) * len(sweep)] if owners else [(0.5,), (0.7,)]
    )
    lacking = [cell.settings(made).policy for cell in found if cell.policy == "baseline"]
    assert lacking == [load_settings().policy] * len(lacking)


def test_a_setting_that_no_policy_of_the_design_reads_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    unread = design(sweep={"wait_s": [1, 2]}, policies=["baseline", "skip"])
    with pytest.raises(PaveTwinError, match=r"no policy of the design reads wait_s; of all, hover does\."):
        owners_of(unread)
    monkeypatch.setattr(policy_class("micro"), "reads", frozenset({"wait_s"}))
    with pytest.raises(PaveTwinError, match=r"of all, hover and micro do\."):
        owners_of(unread)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("owners") / "cross"
    save_world(damaged("cross", 6), folder)
    return folder


def test_a_study_flies_reports_and_keeps_the_settings_of_each_policy(world: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE.format("first"))
    mine, folder, notices = f"{tmp_path / 'mine.py'}:Mine", tmp_path / "study", list[str]()
    made = design(
        worlds=[str(world)], densities=["low"], altitudes_m=[6], policies=[mine, "hover"], presets=["paper"],
        replicates=1, sweep={"wait_s": [1, 4]}, compare="mine",
    )  # fmt: skip
    ran = run(made, folder, Single(), on_notice=notices.append)
    assert notices == ["Only hover has wait_s: mine is flown once for all its values. That makes 3 missions."]
    assert ran.plan.missions == ran.missions_flown == 3
    assert ran.table.select("policy", SET).rows() == [("mine", None), ("hover", 1.0), ("hover", 4.0)]
    assert run(made, folder, Single()).missions_flown == 0

    (tmp_path / "mine.py").write_text(MINE.format("second"))
    notices.clear()
    assert run(made, folder, Single(), on_notice=notices.append).missions_flown == 1
    assert notices[0].startswith("mine.py changed since: 1 of 3 missions are flown again")
    assert Store(folder).former().select("policy", SET).rows() == [("mine", None)]
    assert_frame_equal(Store(folder).table().drop("files_hash"), ran.table.drop("files_hash"))

    described = yaml.safe_load((folder / "design.yaml").read_text())
    assert described.pop("owners") == {"wait_s": ["hover"]}
    (folder / "design.yaml").write_text(yaml.safe_dump(described))
    with pytest.raises(PaveTwinError, match=r"begun when wait_s belonged to every policy and sensor, not to hover;"):
        run(made, folder, Single())


def whole_and_sparse() -> tuple[pl.DataFrame, pl.DataFrame]:
    """A study of `wait_s` in which every policy was flown at each level, and the same with each mission once."""

    def truth(cell: dict[str, Any]) -> dict[str, float]:
        waits = cell["policy"] == "hover"
        return {"coverage": 0.03 * cell[SET] * waits - 0.02 * (cell["policy"] == "micro"), "time_s": 9.0 * waits}

    levels = {**SMALL, "traffic": ("low",), "preset": ("paper",), SET: WAITS_S}
    drawn = study(levels, 12, truth)
    once = drawn.filter((pl.col("policy") == "hover") | (pl.col(SET) == WAITS_S[0]))
    sparse = once.with_columns(pl.when(policy="hover").then(SET))
    others = once.filter(pl.col("policy") != "hover").drop(SET)
    copies = others.join(pl.DataFrame({SET: WAITS_S}), how="cross").select(drawn.columns)
    return pl.concat([once.filter(policy="hover"), copies]), sparse


def test_statistics_are_those_of_a_study_that_flew_everything_at_every_level() -> None:
    whole, sparse = whole_and_sparse()
    by, factors = ["altitude_m", "policy", SET], ["policy", SET]
    explained = effects(sparse, factors)
    assert explained.height
    order = ["metric", "term"]
    assert_frame_equal(explained.sort(order), effects(whole, factors).sort(order), check_exact=False)

    found, expected = differences(sparse, by), differences(whole, by)
    of_hover = pl.col("policy") == "hover"
    assert_frame_equal(found.filter(of_hover), expected.filter(of_hover), check_row_order=False, check_exact=False)
    (once,) = found.filter(policy="micro", metric="coverage").to_dicts()
    first = expected.filter(policy="micro", **{"metric": "coverage", SET: WAITS_S[0]}).row(0, named=True)
    assert once == {**first, SET: None}

    to_hover = differences(sparse, by, reference="hover").filter(policy="micro", metric="coverage")
    assert to_hover[SET].to_list() == list(WAITS_S)
    same = differences(whole, by, reference="hover").filter(policy="micro", metric="coverage")
    assert_frame_equal(to_hover, same, check_row_order=False, check_exact=False)
    assert differences(sparse, by, factor=SET, reference=1.0)["policy"].unique().to_list() == ["hover"]


def test_reports_and_recommendations_show_one_set_of_missions_at_every_level() -> None:
    _, sparse = whole_and_sparse()
    plain = {"sweep": {"wait_s": list(WAITS_S)}, "presets": ["paper"], "policies": ["baseline", "hover", "micro"]}
    made = gather("A study", plain, sparse, {})
    (group,) = made.groups()
    table = headline_table(group, metric_named("coverage"))
    assert [row[2].text for row in table.rows] == ["1", "2", "8"]
    mean = sparse.filter(policy="baseline")["coverage"].mean()
    assert {row[3].text.split(" ±")[0] for row in table.rows} == {f"{100 * mean:.1f}"}, "baseline"
    assert len({row[4].text for row in table.rows}) == 3, "hover"
    note = "The same missions of baseline and micro stand with every value of wait_s, which they do not have."
    assert note in table.notes
    text = page_of(made)
    assert "baseline, hover and micro) × 3 values of wait_s (1, 2 and 8)" in text
    assert "At “without” stand policies that have no wait_s: baseline and micro." in text
    assert "None" not in text
    (advice,) = advise(sparse, MissionLimits())
    options = advice.recommendation.options
    assert options.height == 5
    assert options.row(0, named=True)[SET] == 8.0
    assert options.filter(policy="baseline")[SET].to_list() == [None]
    assert advice.sentences[0].startswith("Fly hover at 6 m with wait_s = 8:")
    assert "the next option, hover at 6 m with wait_s = 2, is " in advice.sentences[1]
