"""The sizes of effects: what is compared with what, where the truth is, and the whole command over a tiny town."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from benchmarks.effects import __main__ as command
from benchmarks.effects import catalogue
from benchmarks.effects.catalogue import VARIANTS, Kind, Variant, design_of
from benchmarks.effects.cracks import Highest, highest, reach
from benchmarks.effects.plot import COLOURS, legend
from benchmarks.effects.sizes import ALL, FLIGHT, Effect, effects, proposed, ranked, value
from benchmarks.effects.table import default_line, effects_table, proposals_table, tours_table
from benchmarks.effects.tour import naive_certainty, tours

from pavetwin.experiments.design import Design
from pavetwin.experiments.engines import Single
from pavetwin.experiments.plan import cells_of
from pavetwin.experiments.run import run
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.experiments.store import Store
from pavetwin.uav import camera_of
from scenes.parking import save_cross_with_rows
from scenes.studies import study

LEVELS = {
    "world": ("ash", "elm"),
    "traffic": ("los-C",),
    "altitude_m": (10.0, 15.0),
    "policy": ("baseline", "hover"),
    "sensor": ("recall",),
    "preset": ("default",),
}
LOW, HIGH = {"altitude_m": 10.0, "policy": "hover"}, {"altitude_m": 15.0, "policy": "hover"}


def flown(better: dict[str, Any], by: float, **added: float) -> pl.DataFrame:
    """A study in which one option finds so much more than the others, and hovering at 10 m measures more as well."""

    def truth(cell: dict[str, Any]) -> dict[str, float]:
        more = added if (cell["altitude_m"], cell["policy"]) == FLIGHT else {}
        return {**more, "coverage": by if better.items() <= cell.items() else 0.0}

    table = study(LEVELS, 12, truth, seed=1)
    return table.with_columns(
        permanently_hidden=pl.lit(0.1),
        segment=pl.format("s{}", pl.col("replicate")),
        batteries=pl.lit(2),
        length_m=pl.lit(80.0),
        defects=pl.lit(15),
    )


def lost(effect: Effect, column: str = "mean") -> float:
    assert effect.decision is not None
    return value(effect.decision, "coverage", column)


def of_all(found: list[Effect]) -> Effect:
    return next(effect for effect in found if effect.scope == ALL)


def changed(kind: Kind, reference: pl.DataFrame, table: pl.DataFrame) -> list[Effect]:
    return effects(Variant("new", "something new", kind), reference, table, MissionLimits())


def test_the_same_flight_is_compared_in_pairs_in_each_world_and_in_all() -> None:
    """The same noise on both sides leaves the change alone."""
    found = changed(Kind.LEFT_OUT, flown(LOW, 0.2), flown(LOW, 0.2, time_s=7.0, surface_coverage=-0.05))
    assert [effect.scope for effect in found] == ["ash", "elm", ALL]
    for effect in found:
        assert value(effect.flight, "time_s", "mean") == pytest.approx(7.0)
        assert value(effect.flight, "time_s", "high") == pytest.approx(7.0)
        assert value(effect.flight, "surface_coverage", "mean") == pytest.approx(-0.05)
        assert value(effect.flight, "coverage", "mean") == 0.0
        assert effect.decision is None
    assert value(of_all(found).flight, "time_s", "pairs") == 2 * value(found[0].flight, "time_s", "pairs") == 24


@pytest.mark.slow
def test_the_loss_of_a_decision_is_told_where_the_truth_is() -> None:
    """10 m are better by 30 points as it is now, 15 m by 10 where something is changed. Who leaves out what the twin
    knows loses the 30, who does not know of another day the 10."""
    now, other = flown(LOW, 0.3), flown(HIGH, 0.1)
    left_out, condition = (of_all(changed(kind, now, other)) for kind in (Kind.LEFT_OUT, Kind.CONDITION))
    assert left_out.options == condition.options == ((10.0, "hover"), (15.0, "hover"))
    assert lost(left_out) == pytest.approx(-0.3, abs=0.03)
    assert lost(condition) == pytest.approx(-0.1, abs=0.03)
    assert lost(condition, "low") < lost(condition, "high") < 0


def test_replicates_over_other_segments_are_no_pairs() -> None:
    now = flown(LOW, 0.2)
    moved = pl.when(pl.col("replicate") < 5).then(pl.lit("elsewhere")).otherwise(pl.col("segment"))
    other = now.with_columns(segment=moved)
    assert value(of_all(changed(Kind.LEFT_OUT, now, other)).flight, "coverage", "pairs") == 2 * 7
    assert value(of_all(changed(Kind.CHANCE, now, other)).flight, "coverage", "pairs") == 2 * 12


@pytest.mark.slow
def test_the_largest_change_comes_first_whatever_it_is_of() -> None:
    """Of time and energy by a third, of what the decision finds by a tenth, of the surface by a fiftieth."""
    now = flown(LOW, 0.1)
    seen = changed(Kind.LEFT_OUT, now, flown(LOW, 0.1, surface_coverage=-0.014))
    lost = changed(Kind.ASSUMPTION, now, flown(HIGH, 0.1))
    used = changed(Kind.CONDITION, now, flown(LOW, 0.1, time_s=20.0))
    order = [effect.variant.kind for effect in ranked([*seen, *lost, *used])]
    assert order == [Kind.CONDITION, Kind.ASSUMPTION, Kind.LEFT_OUT]
    row = effects_table(used, Kind.CONDITION).splitlines()[2]
    assert row.startswith(
        "| something new | 0 | 0 | **+35** (+35 to +35) | **+35** (+35 to +35) | hover, 10\u00a0m | same |"
    )
    assert " of 90.0 %" in default_line(now, MissionLimits()), "what parked vehicles leave to be seen"
    assert default_line(now, MissionLimits()).endswith("12 replicates in each of 2 worlds, 15 defects a segment.")
    assert proposals_table(now, used, MissionLimits()).splitlines()[-1] == "| something new | same | same |"


def test_proposals_that_flip_say_what_they_lose_with_an_interval() -> None:
    flipped = changed(Kind.ASSUMPTION, flown(LOW, 0.3), flown(HIGH, 0.1))
    row = proposals_table(flown(LOW, 0.3), flipped, MissionLimits()).splitlines()[-1]
    (cell, _) = row.split(" | ")[1:]
    told = re.fullmatch(r"hover, 15\u00a0m: \*\*(−[\d.]+)\*\* \((−[\d.]+) to (−[\d.]+)\)", cell)
    assert told is not None
    mean, low, high = (float(value.replace("−", "-")) for value in told.groups())
    assert low < mean < high < 0
    assert mean == pytest.approx(-10, abs=3)


@pytest.mark.parametrize(
    ("mean", "falls", "told"),
    [(0.4, 0.01, "21\u00a0m"), (0.2, 0.01, "under 6\u00a0m"), (0.5, 0.0, "over 30\u00a0m"), (0.3, 0.01, "11\u00a0m")],
)
def test_how_high_a_quarter_is_found(mean: float, falls: float, told: str) -> None:
    """What is found falls evenly with every metre above 6 m."""
    levels = {**LEVELS, "altitude_m": (6.0, 10.0, 15.0, 30.0)}
    table = study(levels, 12, lambda cell: {"coverage": mean - 0.7 - falls * (cell["altitude_m"] - 6)}, seed=3)
    reached = reach(table)
    assert str(reached).split(" (")[0] == told
    assert reached.low_m <= reached.altitude_m <= reached.high_m
    assert (reached.low_m < reached.high_m) == bool(reached.altitude_m and np.isfinite(reached.altitude_m))


def test_the_highest_option_with_a_quarter_found_is_proposed_with_how_sure_it_is() -> None:
    """The less is lost by every metre, the higher: from nowhere, from 15 m, from 30 m."""

    def proposal(falls: float) -> Highest:
        levels = {**LEVELS, "world": ("ash",), "altitude_m": (6.0, 15.0, 30.0), "policy": ("hover", "micro")}

        def truth(cell: dict[str, Any]) -> dict[str, float]:
            return {"coverage": -0.25 - falls * cell["altitude_m"] - 0.02 * (cell["policy"] == "micro")}

        return highest(study(levels, 8, truth, seed=1))

    made = [proposal(falls) for falls in (0.05, 0.01, 0.001)]
    assert [each.option for each in made] == [None, (15.0, "hover"), (30.0, "hover")]
    assert str(made[0]) == "none"
    assert re.fullmatch(r"hover, 15\u00a0m \((over )?9\d\u00a0?\s?%\)", str(made[1]))


def test_the_legend_names_the_kinds_that_are_drawn() -> None:
    found = changed(Kind.LEFT_OUT, flown(LOW, 0.2), flown(HIGH, 0.1))
    assert legend(found) == {"the twin without it": COLOURS[Kind.LEFT_OUT]}
    both = [*found, *changed(Kind.CHANCE, flown(LOW, 0.2), flown(HIGH, 0.1))]
    assert list(legend(both)) == ["the twin without it", "chance: another seed"]


def test_an_inspection_before_and_after_is_told_with_how_sure_it_is() -> None:
    (ash, elm) = tours(flown(LOW, 0.004), flown(HIGH, 0.3, time_s=9.0), MissionLimits())
    assert (ash.world, elm.world) == ("ash", "elm")
    assert ash.after.option == (15.0, "hover")
    assert ash.after.certainty is not None
    assert ash.after.certainty > 0.9
    assert ash.before.certainty < ash.after.certainty
    assert naive_certainty(flown(LOW, 0.3), MissionLimits()) == 1.0
    lead = tours_table([ash, elm], 1).splitlines()[0]
    assert "80 m of street and 15 defects on average" in lead
    assert "today's worlds and road networks" in lead


def test_every_effect_is_a_valid_study_and_changes_what_it_says() -> None:
    seen = {}
    for variant in VARIANTS:
        design = design_of(variant, [Path("town")], "los-C", 2)
        assert isinstance(design, Design)
        seen[variant.name] = (
            design.densities, design.seed, str(design.defects), cells_of(design)[0].settings(design).model_dump_json()
        )  # fmt: skip
    assert len(set(seen.values())) == len(VARIANTS)
    assert {variant.against for variant in VARIANTS} <= set(seen)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cross with a row of parking places on the carriageway of every segment."""
    return save_cross_with_rows(tmp_path_factory.mktemp("effects") / "cross", 3)


@pytest.fixture
def typed(town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A command line with one altitude, fewer defects, and the same light traffic in all studies."""
    monkeypatch.setattr(catalogue, "ALTITUDES_M", (10.0,))
    monkeypatch.setattr(catalogue, "DEFECTS", {"population": "paper", "per_segment": 3})
    monkeypatch.setattr(command, "BEFORE", replace(command.BEFORE, traffic=None))
    variants = [command.BEFORE if each.name == "before" else each for each in VARIANTS]
    monkeypatch.setattr(command, "VARIANTS", variants)
    return [str(town), "-o", str(tmp_path), "--replicates", "2", "--traffic", "low", "--jobs", "1"]


@pytest.mark.slow
def test_the_command_flies_compares_and_resumes(
    typed: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    typed += ["--only", "no-parking"]
    assert command.main(typed) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "effects.md").read_text(encoding="utf-8").strip() == printed.strip()
    assert (tmp_path / "effects.png").stat().st_size > 10_000
    table = pl.read_csv(tmp_path / "effects.csv").filter(variant="no-parking", world=ALL, of="the same flight")
    seen, hidden = (table.row(by_predicate=pl.col("metric") == name, named=True) for name in SURFACE)
    assert seen["mean"] > 0.02, "more is seen where nobody parks"
    assert seen["mean"] == pytest.approx(seen["after"] - seen["before"])
    assert hidden["after"] == 0.0
    assert hidden["before"] > 0.02
    before = {part: part.stat().st_mtime_ns for part in (tmp_path / "studies").rglob("*-low.parquet")}
    assert len(before) == 2 * 2
    assert command.main(typed) == 0
    assert {part: part.stat().st_mtime_ns for part in before} == before, "what is flown is not flown again"


SURFACE = ("surface_coverage", "permanently_hidden")


@pytest.mark.slow
def test_the_command_flies_whole_inspections_before_and_after(
    typed: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main([*typed, "--only", "before", "--tours", "2", "--segments", "2"]) == 0
    alone, told = capsys.readouterr().out.split("2 segments in one mission: ")
    assert "1 segment in one mission: " in alone
    before, after = (line.split(" | ") for line in told.strip().splitlines()[4:6])
    assert before[:2] == ["| cross", "before"]
    assert before[5].endswith("of 100.0")
    assert float(after[5].split(" of ")[1]) < 98
    assert after[-1] == "1 |"


def test_an_effect_that_is_not_known_is_refused(town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([str(town), "-o", str(tmp_path), "--only", "rain"]) == 2
    assert "no effect 'rain'" in capsys.readouterr().err


CRACKS = [variant for variant in VARIANTS if variant.name.startswith("cracks")]
ANY_SIZE = next(variant for variant in VARIANTS if variant.name == "any-size")


@pytest.mark.slow
def test_how_high_cracks_are_found_follows_the_ground_resolution(town: Path, tmp_path: Path) -> None:
    """Finer pixels behind the same lens: one may fly higher. The pixel on the ground stays within a factor of three.
    Where cracks of any size are found, what is proposed is no longer the lowest altitude."""
    reaches, pixels, altitudes, proposals = {}, {}, {}, {}
    for variant in (*CRACKS, ANY_SIZE):
        design = design_of(
            variant, [town], "low", 8, altitudes_m=[6, 10, 15, 30, 60], policies=["hover"], segments=2,
            defects={"population": "paper", "per_segment": 20, "mix": {"single_crack": 1}},
        )  # fmt: skip
        run(design, tmp_path / variant.name, Single())
        table = Store(tmp_path / variant.name).table()
        reaches[variant.name], altitudes[variant.name] = reach(table), proposed(table, MissionLimits())[0]
        proposals[variant.name] = highest(table).option
        settings = cells_of(design)[0].settings(design)
        pixels[variant.name] = camera_of(settings).ground_resolution_m(1.0)
    assert pixels["cracks-coarse"] > pixels["cracks"] > pixels["cracks-fine"]
    assert reaches["cracks-coarse"].altitude_m < reaches["cracks"].altitude_m < reaches["cracks-fine"].altitude_m
    shown = [pixels[name] * reaches[name].altitude_m for name in ("cracks", "cracks-fine")]
    assert max(shown) < 3 * min(shown)
    assert altitudes["any-size"] > altitudes["cracks"] == 6.0
    assert proposals["cracks-coarse"] is None
    assert 6.0 <= proposals["cracks"][0] < proposals["cracks-fine"][0] < proposals["any-size"][0] == 60.0
