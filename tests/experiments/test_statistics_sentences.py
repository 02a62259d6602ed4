"""What is concluded and recommended: the truth of a study, and nothing where there is none."""

import re
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import stats

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.statistics import (
    Comparison,
    MissionLimits,
    conclusions,
    differences,
    effects,
    key_findings,
    recommend,
    summarise,
)
from pavetwin.experiments.words import amount, setting
from pavetwin.reports.words import nonzero
from scenes.studies import PAPER, SMALL, study, without

BY = ("traffic", "altitude_m", "policy")
SPOKEN = [metric_named(name) for name in ("coverage", "time_s", "energy", "wait_s")]
CLAIM = re.compile(r"p [=<] 0\.|is explained by")


def concluded(table: pl.DataFrame, factor: str = "policy", reference: Any = "baseline") -> list[str]:
    compared = Comparison(factor, reference, "", differences(table, BY, factor=factor, reference=reference))
    return conclusions(summarise(table, BY, SPOKEN), [compared], effects(table, BY, SPOKEN))


def hover_helps_in_high_traffic(cell: dict[str, Any]) -> dict[str, float]:
    busy = cell["traffic"] == "high"
    added = {"hover": (0.06, 30.0), "skip": (-0.05, 0.0)}.get(cell["policy"], (0.0, 0.0))
    return {"coverage": added[0] * busy + 0.01 * cell["altitude_m"], "time_s": added[1] * busy}


@pytest.fixture(scope="module")
def helped() -> pl.DataFrame:
    return study(PAPER, truth=hover_helps_in_high_traffic)


@pytest.fixture(scope="module")
def helped_said(helped: pl.DataFrame) -> list[str]:
    return concluded(helped)


def test_a_real_difference_is_told_with_its_interval_and_its_price(helped_said: list[str]) -> None:
    first, second, silent, *rest = helped_said
    assert re.fullmatch(
        r"In high traffic at \d+ m, coverage is \d\.\d percentage points higher with hover than with baseline "
        r"\(95 % interval \d\.\d to \d\.\d, p (?:= 0\.\d+|< 0\.001)\); "
        r"in 2 more of the 9 settings it is \d\.\d to \d\.\d percentage points higher\.",
        first,
    )
    assert re.search(r"coverage is \d\.\d percentage points lower with skip than with baseline", second)
    assert silent.startswith(
        "No difference in coverage from baseline could be shown for hover and skip in 6 of 9 settings"
    )
    assert "micro in any of the 9 settings" in silent
    assert "are not excluded there" in silent
    assert any(re.match(r"In high traffic.*time is \d+\.\d s higher with hover", sentence) for sentence in rest)
    assert "Intervals and p of differences from baseline are corrected for 81 comparisons." in rest
    explained = next(sentence for sentence in rest if sentence.startswith("Of the variance in coverage"))
    assert re.search(r"\d+ % lies between segments \(replicates\), \d+ % is explained by altitude", explained)


def test_shown_numbers_are_those_of_the_tables(helped: pl.DataFrame, helped_said: list[str]) -> None:
    gaps = differences(helped, BY).filter(metric="coverage", traffic="high", policy="hover")
    largest = gaps.sort("mean", descending=True).row(0, named=True)
    first = helped_said[0]
    assert f"coverage is {100 * largest['mean']:.1f} percentage points higher with hover" in first
    assert f"(95 % interval {100 * largest['low']:.1f} to {100 * largest['high']:.1f}," in first


@pytest.mark.parametrize("studies", [5, pytest.param(60, marks=pytest.mark.slow)])
def test_nothing_is_claimed_where_there_is_nothing(studies: int) -> None:
    """Studies without an effect: differences at 5 %, factors at 1 %, within what chance allows."""
    false = [sum(bool(CLAIM.search(said)) for said in concluded(study(seed=seed))) > 0 for seed in range(studies)]
    assert sum(false) <= stats.binom.ppf(0.999, studies, 0.06)


def test_no_claim_has_an_interval_with_zero_in_it() -> None:
    for seed in range(5):
        for said in concluded(study(SMALL, 10, hover_helps_in_high_traffic, seed)):
            for low, high in re.findall(r"interval (−?[\d.]+) to (−?[\d.]+)", said):
                assert 0 < float(low) <= float(high)


def test_a_finding_names_its_one_setting_or_counts_within_its_traffic() -> None:
    def found(*altitudes: float) -> str:
        def helped(cell: dict[str, Any]) -> dict[str, float]:
            helps = cell["policy"] == "hover" and cell["traffic"] == "high" and cell["altitude_m"] in altitudes
            return {"coverage": 0.2 * helps}

        table = study({**SMALL, "altitude_m": (6.0, 10.0, 15.0)}, truth=helped)
        rows = differences(table, BY, factor="policy", reference="baseline")
        return key_findings([Comparison("policy", "baseline", "", rows)])[0]

    assert found(10.0).startswith("In high traffic, coverage is ")
    assert "higher with hover than with baseline (at 10 m)" in found(10.0)
    assert "higher with hover than with baseline (2 of 3 settings)" in found(6.0, 10.0)


def test_at_most_a_dozen_sentences() -> None:
    policies = ("baseline", *(f"policy {k}" for k in range(5)))
    table = study({**SMALL, "policy": policies}, 18, lambda cell: {
        "coverage": -0.02 * policies.index(cell["policy"]), "time_s": 10.0 * policies.index(cell["policy"]),
    })  # fmt: skip
    said = concluded(without(table, pl.col("replicate") == 0, failed=True))
    assert len(said) <= 12
    assert any("The table of differences has 2 more" in sentence for sentence in said)


def test_too_few_replicates_are_said_to_be_too_few() -> None:
    said = concluded(study(PAPER, 5, hover_helps_in_high_traffic))
    assert any("With 5 replicates no difference from baseline, however large" in sentence for sentence in said)
    assert any("; with so few pairs a difference cannot be excluded there." in sentence for sentence in said)
    assert not any(re.search("p [=<]", sentence) for sentence in said)


def test_a_single_replicate_concludes_nothing() -> None:
    assert concluded(study(replicates=1)) == [
        "Nothing could be compared with baseline: that takes missions of it and of another in the same two replicates."
    ]


def test_failed_and_undefined_missions_are_told() -> None:
    table = without(study(), pl.col("replicate") == 2, failed=False)
    table = without(table, (pl.col("replicate") == 3) & (pl.col("policy") == "micro"), failed=True)
    assert concluded(table)[-1] == (
        "2 of 120 missions failed and 6 of 120 missions had no defects to find; "
        "they are in no mean coverage, neither as 0 nor as 100 %."
    )


def test_a_heavy_tail_is_told() -> None:
    table = study()
    waits = np.where(table["policy"] == "hover", np.random.default_rng(0).lognormal(3, 1.3, table.height), 0.0)
    said = concluded(table.with_columns(wait_s=pl.Series(waits)))
    assert any(re.match(r"Waiting has a heavy tail: in \w+ traffic with hover its median was", it) for it in said)


@pytest.mark.parametrize(
    ("waits", "heavy"),
    [
        ((100, 105, 110, 117, 120, 286), False),
        ((2, 3, 3, 4, 4, 4, 4, 5, 5, 6, 9, 18), False),
        ((90, 95, 98, 99, 100, 100, 101, 104, 160, 170, 180, 190), False),
        ((9, 10, 10, 11, 12, 14, 15, 16, 90, 120, 240, 260), True),
    ],
)
def test_few_missions_or_small_waits_make_no_heavy_tail(waits: tuple[int, ...], heavy: bool) -> None:
    table = study({**SMALL, "policy": ("hover",), "traffic": ("low",)}, len(waits))
    said = conclusions(summarise(table.with_columns(wait_s=pl.Series(waits)), BY, SPOKEN), [], effects(table, ()))
    assert any("heavy tail" in sentence for sentence in said) is heavy


def test_the_sentence_on_factors_says_how_it_names_them(helped_said: list[str]) -> None:
    silent = concluded(study())
    rule = "A factor is named where it holds at 1 % after Holm's correction for {} terms."
    assert rule.format(6) in helped_said
    assert any("none could be shown to be explained by a factor" in it for it in silent)
    assert rule.format(3) in silent


def test_energy_is_told_by_itself_where_time_is_not(helped: pl.DataFrame) -> None:
    dearer = helped.with_columns(energy=pl.col("energy") + 0.01 * (pl.col("policy") == "micro"))
    said = [sentence for sentence in concluded(dearer) if "energy is" in sentence]
    assert len(said) == 1
    assert re.search(r"energy is 1\.\d\d % of a battery higher with micro", said[0])


def test_other_factors_are_named() -> None:
    table = study(PAPER, truth=lambda cell: {"coverage": 0.01 * cell["altitude_m"]})
    first = concluded(table, "altitude_m", 6.0)[0]
    assert re.match(r"In \w+ traffic with \w+, coverage is .* higher at 15 m than at 6 m", first)


def test_wording() -> None:
    cell = {"traffic": "high", "altitude_m": 6.0, "tau_o": 0.7, "swap": True}
    assert (
        setting(cell, ("tau_o", "altitude_m", "traffic", "swap"))
        == "in high traffic at 6 m with tau_o = 0.7 with swap = yes"
    )
    assert nonzero(-0.04, 1) == "−0.04"
    assert nonzero(-0.0, 1) == "0.0"
    assert amount(metric_named("energy"), 0.0312) == "3.12 % of a battery"


def three_options(cell: dict[str, Any]) -> dict[str, float]:
    coverage, seconds = {"baseline": (0.0, 0.0), "hover": (0.1, 40.0), "micro": (0.05, 5.0)}[cell["policy"]]
    return {"coverage": coverage, "time_s": seconds}


@pytest.mark.parametrize(
    ("limits", "policy"),
    [
        (MissionLimits(), "hover"),
        (MissionLimits(max_time_s=80.0), "micro"),
        (MissionLimits(max_energy=80.0 / 1800), "micro"),
        (MissionLimits(max_time_s=62.5), "baseline"),
        (MissionLimits(max_time_s=80.0, min_coverage=0.72), "micro"),
    ],
)
def test_the_best_under_the_limits_is_recommended(limits: MissionLimits, policy: str) -> None:
    table = study(replicates=30, truth=three_options, seed=4)
    made = recommend(table, limits)
    assert made.best is not None
    assert made.best["policy"] == policy
    assert made.nearest is None
    assert made.options["policy"][0] == policy
    assert made.sentences[0].startswith(f"Fly {policy} at 6 m: mean coverage ")
    assert made.options["certainty"].sum() <= 1 + 1e-9
    assert (made.options["certainty"] <= made.options["kept"]).all()
    assert "traffic (low and high)" in made.sentences[-1]


def test_where_options_differ_clearly_the_limits_are_judged_as_a_bootstrap_of_its_own_would() -> None:
    table = study(truth=lambda cell: {"coverage": {"baseline": 0.0, "hover": 0.1, "micro": 0.05}[cell["policy"]]})
    made = recommend(table, MissionLimits(max_time_s=61.0), ("policy",))
    wide = table.group_by("policy", "replicate").agg(pl.col("coverage", "time_s").mean()).sort("policy", "replicate")
    coverage, seconds = (wide[name].to_numpy().reshape(3, 20) for name in ("coverage", "time_s"))
    drawn = np.random.default_rng(0).integers(0, 20, (20_000, 20))
    kept = seconds[:, drawn].mean(axis=2) <= 61.0
    best = np.where(kept, coverage[:, drawn].mean(axis=2), -1.0)
    expected = [float(((best.argmax(axis=0) == at) & kept.any(axis=0)).mean()) for at in range(3)]
    found = made.options.sort("policy")
    assert found["certainty"].to_list() == pytest.approx(expected, abs=0.12)
    assert found["kept"].to_list() == pytest.approx(kept.mean(axis=1).tolist(), abs=0.12)


def test_limits_are_judged_in_each_resample_and_told_so() -> None:
    """An option that breaks a limit on average is the best in the resamples that let it pass."""
    times = {"baseline": 60.0, "hover": 61.5, "micro": 70.0}
    shares = {"baseline": 0.8, "hover": 0.9, "micro": 0.95}
    policy, swing = pl.col("policy"), pl.when(pl.col("replicate") % 2 == 0).then(6.0).otherwise(-6.0)
    table = study().with_columns(coverage=policy.replace_strict(shares), time_s=policy.replace_strict(times) + swing)
    made = recommend(table, MissionLimits(max_time_s=60.5), ("policy",))
    by = {row["policy"]: row for row in made.options.to_dicts()}
    assert (made.options["policy"][0], by["hover"]["feasible"]) == ("baseline", False)
    kept = by["baseline"]["certainty"] + by["hover"]["certainty"]
    assert 1 - kept == pytest.approx(stats.binom.sf(10, 20, 0.5), abs=0.03), "more of the slow half are drawn"
    assert made.sentences[1:4] == (
        "No other option keeps the limit.",
        f"Corrected for its choice as the best of 3, its coverage is expected at "
        f"{100 * by['baseline']['coverage_expected']:.1f} %, and it is the best with a probability of "
        f"{100 * by['baseline']['certainty']:.0f} %.",
        f"Its true means may break the limit: with a probability of {100 * (1 - by['baseline']['kept']):.0f} %.",
    )
    easy = recommend(table, MissionLimits(max_time_s=90.0), ("policy",))
    assert (easy.sentences[1], easy.sentences[-1]) == (
        "Within the limit, micro leads; 20 replicates separate it from hover and baseline "
        "(each p < 0.05, not corrected).",
        "This is an average over traffic (low and high).",
    )


def test_what_lies_between_worlds_is_no_chance() -> None:
    """A segment takes a minute in one town and three in the other: half of each was flown, and will be."""
    levels = {**SMALL, "world": ("north", "south")}
    table = study(levels, 12, lambda cell: {"time_s": 120.0 * (cell["world"] == "south")})
    made = recommend(table, MissionLimits(max_time_s=130.0), ("policy",))
    assert made.options["kept"].to_list() == pytest.approx([1.0] * 3, abs=0.01)
    assert "world (north and south)" in made.sentences[-1]


def test_pairs_make_a_small_difference_sure() -> None:
    """The options' intervals overlap, but within every replicate the same one is better."""
    table = study(truth=lambda cell: {"coverage": 0.03 * (cell["policy"] == "hover")})
    best = recommend(table, MissionLimits(), ("policy",)).options.to_dicts()
    assert best[0]["coverage_low"] < best[1]["coverage_high"]
    assert best[0]["certainty"] > 0.95
    assert best[1]["p"] < 0.05


def test_a_choice_that_three_replicates_make_is_not_called_sure() -> None:
    """Nearly every resample draws one of the three that differ, but three coins show nothing."""
    table = study(replicates=10, truth=lambda cell: {"time_s": 30.0 * (cell["policy"] == "hover")})
    ahead = (pl.col("policy") == "hover") & pl.col("replicate").is_in([1, 4, 7])
    table = table.with_columns(coverage=pl.lit(0.8) + 0.1 * ahead.cast(pl.Float64)).filter(pl.col("policy") != "micro")
    made = recommend(table, MissionLimits(), ("policy",))
    assert made.best is not None
    assert made.best["policy"] == "hover"
    assert 0.5 < made.best["certainty"] < 0.95
    assert made.sentences[1] == "Hover leads; 10 replicates cannot separate it from baseline (p = 0.25)."
    limited = recommend(table, MissionLimits(max_time_s=600.0), ("policy",))
    assert limited.sentences[1] == (
        "Within the limit, hover leads; 10 replicates cannot separate it from baseline (p = 0.25)."
    )


def test_when_no_option_keeps_the_limits_the_nearest_is_named() -> None:
    made = recommend(
        study(truth=three_options, replicates=30, seed=4), MissionLimits(max_time_s=50.0, min_coverage=0.65)
    )
    assert made.best is None
    assert made.nearest is not None
    assert (made.nearest["policy"], made.broken) == ("baseline", "time_s")
    assert made.options["feasible"].any() is False
    (sentence,) = made.sentences
    assert sentence.startswith("No option keeps the limits on average: the nearest is baseline at 6 m (coverage 6")
    assert sentence.endswith(", is above 50.0 s.")


@pytest.mark.parametrize(
    ("twins", "said"),
    [
        (["twin"], "Twin is the same in everything."),
        (["one", "two"], "One and two are the same in everything."),
        (["one", "two", "three", "four", "five"], "One, two, three and 2 more are the same in everything."),
    ],
)
def test_how_sure_a_choice_is_does_not_depend_on_how_many_do_the_same(twins: list[str], said: str) -> None:
    """A setting that cannot matter to a policy makes options of it that differ in name alone."""
    table = study(truth=lambda cell: {"coverage": 0.004 * (cell["policy"] == "hover")})
    alone = recommend(table, MissionLimits(), ("policy",))
    hover = table.filter(policy="hover")
    made = recommend(
        pl.concat([table, *(hover.with_columns(policy=pl.lit(twin)) for twin in twins)]), MissionLimits(), ("policy",)
    )
    share = alone.options["certainty"][0]
    assert 0.3 < share < 0.95
    assert made.options["policy"].to_list()[: 1 + len(twins)] == ["hover", *twins]
    assert made.options["same"].to_list() == [True] * (1 + len(twins)) + [False, False]
    assert made.options["certainty"].to_list()[: 1 + len(twins)] == [share] * (1 + len(twins))
    assert made.sentences[1] == alone.sentences[1], "they are not rivals"
    assert said in made.sentences
    assert not any("the choice is by time" in sentence for sentence in made.sentences)


def test_of_equal_coverages_the_faster_is_recommended() -> None:
    table = study(truth=lambda cell: {"time_s": 20.0 * (cell["policy"] != "micro")})
    made = recommend(table.with_columns(coverage=pl.lit(1.0)), MissionLimits(), ("policy",))
    assert made.options["policy"][0] == "micro"
    assert made.options["certainty"][0] > 0.99
    assert any("found as much; the choice is by time, then by energy" in sentence for sentence in made.sentences)
    assert not any("the same in everything" in sentence for sentence in made.sentences)


def test_an_option_without_coverage_is_never_recommended() -> None:
    table = without(study(truth=three_options), pl.col("policy") == "hover", failed=False)
    made = recommend(table, MissionLimits(), ("policy",))
    assert made.options["policy"].to_list() == ["micro", "baseline", "hover"]
    assert made.options["feasible"].to_list() == [True, True, False]
    nothing = recommend(without(table, pl.lit(True), failed=True), MissionLimits(max_time_s=1.0))
    assert (nothing.best, nothing.nearest) == (None, None)


def test_an_option_that_crashes_on_the_hardest_street_is_not_recommended() -> None:
    """Its mean leaves out the replicate that is hard for all, and would be the best."""
    hard = pl.col("replicate") == 0
    table = study(truth=three_options).with_columns(
        coverage=pl.when(hard).then(0.0).when(policy="baseline").then(0.88).otherwise(0.9)
    )
    made = recommend(without(table, hard & (pl.col("policy") == "baseline"), failed=True), MissionLimits(), ("policy",))
    assert made.options["policy"].to_list() == ["micro", "hover", "baseline"]
    assert made.options["coverage"][2] > made.options["coverage"][0]
    assert made.options["failed_alone"].to_list() == [0, 0, 2]
    assert made.options["certainty"][2] == 0
    assert "Left out, since their means lack missions that others flew: baseline (2 failed)." in made.sentences
    nothing = recommend(
        without(table, hard & (pl.col("policy") == "baseline"), failed=True), MissionLimits(1.0), ("policy",)
    )
    assert nothing.nearest is not None
    assert nothing.nearest["policy"] != "baseline"
    assert "baseline (2 failed)" in nothing.sentences[-1]


def test_missions_that_no_option_flew_keep_none_from_being_recommended() -> None:
    table = without(study(truth=three_options), pl.col("replicate") == 0, failed=True)
    table = without(table, pl.col("replicate") == 1, failed=False)
    made = recommend(table, MissionLimits(), ("policy",))
    assert made.options["policy"][0] == "hover"
    assert made.options["failed_alone"].to_list() == [0, 0, 0]
    assert any("2 of its missions failed, as with every option" in sentence for sentence in made.sentences)


@pytest.mark.parametrize("replicates", [2, 4])
def test_few_replicates_recommend_without_a_share_and_without_limits_of_none(replicates: int) -> None:
    """However many missions they are: those of one replicate share their street."""
    made = recommend(study(PAPER, replicates, three_or_skip), MissionLimits(), ("policy",))
    assert made.best is not None
    assert made.sentences[1] == f"{replicates} replicates are too few to separate options: fly at least 5."
    assert made.options["certainty"].null_count() == made.options.height
    assert not any("limit" in sentence or "probability" in sentence for sentence in made.sentences)


def three_or_skip(cell: dict[str, Any]) -> dict[str, float]:
    return {"coverage": 0.1 * (cell["policy"] == "skip")}


def test_without_limits_none_are_spoken_of() -> None:
    made = recommend(study(truth=three_options), MissionLimits(), ("policy",))
    assert made.sentences[1].startswith("Hover leads; 20 replicates")
    assert not any("limit" in sentence for sentence in made.sentences)


def test_of_options_that_miss_by_as_much_the_one_that_finds_most_is_the_nearest() -> None:
    seconds = {"baseline": 60.3, "hover": 60.0, "micro": 61.5}
    shares = {"baseline": 0.8, "hover": 0.6, "micro": 0.9}
    table = study(replicates=6)
    policy = pl.col("policy")
    table = table.with_columns(
        time_s=policy.replace_strict(seconds), coverage=policy.replace_strict(shares), energy=pl.lit(0.01)
    )
    made = recommend(table, MissionLimits(max_time_s=50.0), ("policy",))
    assert made.nearest is not None
    assert made.nearest["policy"] == "baseline"
    assert ": the nearest is baseline (coverage 80.0 %), whose time, 60.3 s" in made.sentences[0]


def test_one_replicate_recommends_without_saying_how_sure() -> None:
    made = recommend(study(replicates=1), MissionLimits(), ("policy",))
    assert made.best is not None
    assert made.sentences[1] == "One replicate is too few to separate options: fly at least 5."


@pytest.mark.parametrize(
    "wrong", [{"max_time_s": 0.0}, {"max_energy": -1.0}, {"max_time_s": float("nan")}, {"min_coverage": 80.0}]
)
def test_limits_that_are_none_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(PaveTwinError, match="`m"):
        MissionLimits(**wrong)


@pytest.mark.parametrize(("replicates", "said"), [(1, False), (2, True), (9, True), (10, False)])
def test_intervals_of_few_replicates_are_called_rough(replicates: int, said: bool) -> None:
    assert any("are rough" in sentence for sentence in concluded(study(replicates=replicates))) is said
