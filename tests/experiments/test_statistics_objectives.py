"""What the best option is: the highest, the fastest, or the one of least energy that still finds enough."""

from typing import Any

import numpy as np
import polars as pl
import pytest
from benchmarks.calibration import OBJECTIVES, outcomes

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.statistics import MissionLimits, Objective, recommend
from pavetwin.experiments.statistics.flips import sign_flip_p
from pavetwin.reports.words import percent
from scenes.studies import PAPER, study

LEVELS = {**PAPER, "traffic": ("low",), "altitude_m": (6.0, 15.0, 30.0), "policy": ("baseline", "hover")}
A_QUARTER = MissionLimits(min_coverage=0.25)
FOUND = {6.0: 0.42, 15.0: 0.3, 30.0: 0.15}
TAKEN_S = {6.0: 100.0, 15.0: 60.0, 30.0: 55.0}


def cracks(cell: dict[str, Any]) -> dict[str, float]:
    """Less is found from higher up and in less time; hovering finds two points more and takes 8 s longer."""
    hovers = cell["policy"] == "hover"
    return {
        "coverage": FOUND[cell["altitude_m"]] - 0.7 + 0.02 * hovers,
        "time_s": TAKEN_S[cell["altitude_m"]] - 60.0 + 8.0 * hovers,
    }


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    """From 15 m the least time of those that find a quarter, from 6 m the least energy."""
    flown = study(LEVELS, 12, cracks, seed=1)
    return flown.with_columns(energy=pl.col("energy") + 0.04 * (pl.col("altitude_m") == 15))


@pytest.mark.parametrize(
    ("objective", "option"),
    [
        (Objective.MOST_FOUND, (6.0, "hover")),
        (Objective.HIGHEST, (15.0, "hover")),
        (Objective.FASTEST, (15.0, "baseline")),
        (Objective.LEAST_ENERGY, (6.0, "baseline")),
    ],
)
def test_the_best_of_those_that_find_enough(
    table: pl.DataFrame, objective: Objective, option: tuple[float, str]
) -> None:
    made = recommend(table, A_QUARTER, objective=objective)
    assert made.best is not None
    assert (made.best["altitude_m"], made.best["policy"]) == option
    assert made.sentences[0].startswith(f"Fly {option[1]} at {option[0]:g} m: mean coverage ")
    assert made.best["certainty"] > 0.5
    # Of two options at one altitude both may be the highest, in all samples but a few.
    assert made.best["certainty"] == pytest.approx(made.options["certainty"].max(), abs=0.001)
    assert (made.options["certainty"] <= made.options["kept"]).all()
    assert made.options["feasible"].to_list() == [True] * 4 + [False] * 2


def test_altitudes_that_are_level_are_chosen_by_coverage_and_are_as_good(table: pl.DataFrame) -> None:
    made = recommend(table, A_QUARTER, objective=Objective.HIGHEST)
    first, second = made.options.rows(named=True)[:2]
    assert (second["altitude_m"], second["policy"]) == (15.0, "baseline")
    assert first["certainty"] + second["certainty"] > 1.5, "of two policies at one altitude both are the highest"
    assert first["p"] is second["p"] is None
    level = "Baseline at 15 m keeps the limit too; the choice at this altitude is by coverage, then by time."
    assert level in made.sentences
    (beyond,) = [sentence for sentence in made.sentences if sentence.startswith("No higher option keeps the limit on ")]
    assert "average: the nearest is hover at 30 m, whose coverage, " in beyond
    assert beyond.endswith(", is below 25.0 %.")
    (said,) = [sentence for sentence in made.sentences if sentence.startswith("Corrected for its choice among 6")]
    assert said.endswith("it keeps the limit and no higher option does.")
    top = recommend(table, MissionLimits(min_coverage=0.1), objective=Objective.HIGHEST)
    assert top.best is not None
    assert top.best["altitude_m"] == 30.0
    assert "No higher option was flown." in top.sentences


def test_the_fastest_is_separated_by_time_and_its_time_is_corrected(table: pl.DataFrame) -> None:
    made = recommend(table, A_QUARTER, objective=Objective.FASTEST)
    assert made.sentences[1].startswith("Within the limit, baseline at 15 m is the fastest; 12 replicates")
    (said,) = [sentence for sentence in made.sentences if sentence.startswith("Corrected for its choice among 6")]
    assert f" and its time at {made.options['time_s_expected'][0]:.1f} s; with a probability of " in said
    times = [table.filter(altitude_m=15.0, policy=policy)["time_s"].to_numpy() for policy in ("baseline", "hover")]
    (p,) = sign_flip_p((times[1] - times[0])[np.newaxis])
    assert made.options.filter(altitude_m=15.0)["p"].to_list() == pytest.approx([1.0, p])
    level = table.filter(altitude_m=15.0).with_columns(time_s=pl.lit(60.0))
    tied = recommend(level, A_QUARTER, objective=Objective.FASTEST)
    assert "Baseline at 15 m took as long; the choice is by coverage, then by energy." in tied.sentences
    assert tied.options["policy"].to_list() == ["hover", "baseline"], "of options that take as long who finds more"


def test_an_option_that_keeps_the_limit_just_so_is_told_with_one_that_surely_does(table: pl.DataFrame) -> None:
    """The share that is asked for is what was found from 15 m: it may well be less."""
    hovering = table.filter(altitude_m=15.0, policy="hover")["coverage"].mean()
    made = recommend(table, MissionLimits(min_coverage=hovering - 0.001), objective=Objective.HIGHEST)
    assert made.best is not None
    assert made.best["altitude_m"] == 15.0
    assert 0.3 < made.best["kept"] < 0.7
    assert made.best["certainty"] == pytest.approx(made.best["kept"])
    warned, surer = made.sentences[-2:]
    assert warned.startswith("Its true means may break the limit: with a probability of ")
    assert surer.startswith("Hover at 6 m keeps the limit with a probability of ")


def test_an_option_that_is_likelier_the_best_than_the_proposed_one_is_told_with_the_reason(table: pl.DataFrame) -> None:
    hovering = table.filter(altitude_m=15.0, policy="hover")["coverage"].mean()
    made = recommend(table, MissionLimits(min_coverage=hovering - 0.0001), objective=Objective.FASTEST)
    likelier = made.options.sort("certainty").row(-1, named=True)
    assert (made.best["altitude_m"], likelier["altitude_m"]) == (15.0, 6.0)
    told = f"Baseline at 6 m is the best with a higher probability, {percent(likelier['certainty'])}: the "
    (said,) = [sentence for sentence in made.sentences if "higher probability" in sentence]
    assert said.startswith(told)
    assert said.endswith(" allows for their random errors and for how surely an option keeps the limit.")
    sure = recommend(table, A_QUARTER, objective=Objective.FASTEST)
    assert not any("higher probability" in sentence for sentence in sure.sentences)


@pytest.mark.parametrize("objective", [Objective.HIGHEST, Objective.FASTEST, Objective.LEAST_ENERGY])
def test_where_nothing_finds_enough_one_sentence_names_the_nearest(table: pl.DataFrame, objective: Objective) -> None:
    made = recommend(table, MissionLimits(min_coverage=0.9), objective=objective)
    assert (made.best, made.broken) == (None, "coverage")
    (sentence,) = made.sentences
    assert sentence.startswith("No option keeps the limit on average: the nearest is hover at 6 m, whose coverage, 4")
    assert sentence.endswith(", is below 90.0 %.")


def test_few_replicates_choose_without_saying_how_sure() -> None:
    made = recommend(study(LEVELS, 3, cracks, seed=1), A_QUARTER, objective=Objective.HIGHEST)
    assert made.best is not None
    assert made.best["altitude_m"] == 15.0
    assert "3 replicates are too few to separate options: fly at least 5." in made.sentences
    assert not any("probability" in sentence for sentence in made.sentences)


def test_objectives_that_say_nothing_are_refused(table: pl.DataFrame) -> None:
    for limits in (MissionLimits(), MissionLimits(max_time_s=100.0, max_energy=0.5), MissionLimits(min_coverage=0.0)):
        with pytest.raises(PaveTwinError, match=r"`objective` fastest: without a least coverage .* `min_coverage`"):
            recommend(table, limits, objective=Objective.FASTEST)
    with pytest.raises(PaveTwinError, match="the options have no altitude"):
        recommend(table, A_QUARTER, ("policy",), objective=Objective.HIGHEST)
    with pytest.raises(PaveTwinError, match=r"no objective 'hihgest' \(did you mean 'highest'\?\); known are most-"):
        Objective.named("hihgest")


@pytest.mark.slow
def test_claims_of_other_objectives_hold_in_simulated_studies() -> None:
    """Over 60 studies of each: how sure `recommend` was on average against how often it was right."""
    rows = pl.DataFrame(list(outcomes(30, tuple(OBJECTIVES)))).with_columns(pl.col("right", "kept").cast(pl.Float64))
    for kind in OBJECTIVES:
        of = rows.filter(kind=kind)
        assert of.height > 50
        assert -0.25 < of["after"].mean() - of["right"].mean() < 0.05, kind
        assert abs(of["keeps"].mean() - of["kept"].mean()) < 0.1, kind
    assert np.abs(rows["error_after"].mean()) < 0.015
