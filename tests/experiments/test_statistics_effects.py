"""Analysis of variance against statsmodels, and its error rate where one recording of traffic serves many cells."""

import warnings

import numpy as np
import polars as pl
import pytest
from scipy import stats
from statsmodels.formula.api import ols
from statsmodels.stats.anova import AnovaRM, anova_lm

from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.statistics import effects
from scenes.studies import PAPER, SMALL, study, without

MAIN = [metric_named("coverage")]
FACTORS = ("world", "traffic", "altitude_m", "policy", "sensor")
NAMES = {"C(traffic)": "traffic", "C(altitude_m)": "altitude_m", "C(policy)": "policy", "C(world)": "world"}


def theirs(name: str) -> str:
    return " × ".join(NAMES.get(part, part) for part in name.split(":"))


def some_effects(cell: dict[str, object]) -> dict[str, float]:
    return {
        "coverage": 0.05 * (cell["policy"] == "hover") * (cell["traffic"] == "high") + 0.004 * float(cell["altitude_m"])
    }


def by_term(table: pl.DataFrame, factors: tuple[str, ...] = FACTORS) -> dict[str, dict[str, object]]:
    return {row["term"]: row for row in effects(table, factors, MAIN).to_dicts()}


@pytest.mark.parametrize("kind", [2, 3])
def test_sums_of_squares_agree_with_statsmodels(kind: int) -> None:
    table = study(PAPER, 6, some_effects)
    coding = "Sum" if kind == 3 else "Treatment"
    factors = " + ".join(f"C({name}, {coding})" for name in ("traffic", "altitude_m", "policy"))
    model = ols(f"coverage ~ C(replicate, {coding}) + ({factors}) ** 2", table.to_pandas()).fit()
    expected = anova_lm(model, typ=kind)
    own = by_term(table)
    for name, row in expected.iterrows():
        term = str(name).replace(f", {coding}", "").replace("C(replicate)", "replicate").replace("Residual", "residual")
        if term != "Intercept":
            found = own[theirs(term)]
            assert (found["df"], found["ss"]) == pytest.approx((row["df"], row["sum_sq"])), term
            assert found["eta2"] == pytest.approx(row["sum_sq"] / left(table.to_pandas(), ["1"]))


def test_tests_agree_with_the_analysis_of_repeated_measures() -> None:
    table = study({**PAPER, "altitude_m": (6.0, 10.0)}, 8, some_effects)
    expected = (
        AnovaRM(table.to_pandas(), "coverage", "replicate", within=["traffic", "altitude_m", "policy"])
        .fit()
        .anova_table
    )
    own = by_term(table)
    for name, row in expected.iterrows():
        if str(name).count(":") < 2:
            found = own[theirs(str(name))]
            assert found["f"] == pytest.approx(row["F Value"])
            # Greenhouse and Geisser's correction makes p larger where F > 1, never beyond that of 1 and n − 1.
            worst = stats.f.sf(row["F Value"], 1, 7)
            assert min(row["Pr > F"], worst) * 0.999 <= found["p"] <= max(row["Pr > F"], worst) * 1.001
            if row["Num DF"] == 1:
                assert found["p"] == pytest.approx(row["Pr > F"])


def left(frame: object, terms: list[str]) -> float:
    """The residual sum of squares of a model."""
    with warnings.catch_warnings():
        # Of the rank, since blocks are nested in worlds; what is left does not depend on it.
        warnings.simplefilter("ignore")
        return float(ols("coverage ~ " + " + ".join(terms), frame).fit().ssr)


def test_a_policy_that_works_differently_in_two_worlds() -> None:
    """With two levels, the tests are Student's on the replicates' differences."""
    levels = {**SMALL, "world": ("north", "south"), "policy": ("baseline", "hover"), "traffic": ("low",)}
    helps = {("north", "hover"): 0.08, ("south", "hover"): 0.03}
    table = study(levels, 9, lambda cell: {"coverage": helps.get((cell["world"], cell["policy"]), 0.0)})
    wide = table.pivot("policy", index=["world", "replicate"], values="coverage")
    gaps = [(part["hover"] - part["baseline"]).to_numpy() for part in wide.partition_by("world")]
    unlike = stats.ttest_ind(*gaps)
    own = by_term(table)
    assert own["world × policy"]["f"] == pytest.approx(unlike.statistic**2)
    assert own["world × policy"]["p"] == pytest.approx(unlike.pvalue)
    pooled = (gaps[0].var(ddof=1) + gaps[1].var(ddof=1)) / 2
    assert own["policy"]["f"] == pytest.approx(np.mean(gaps) ** 2 / (pooled / 18))


def test_worlds_are_compared_between_replicates() -> None:
    table = study(
        {**SMALL, "world": ("north", "south")}, 7, lambda cell: {"coverage": 0.1 * (cell["world"] == "south")}
    )
    frame = table.with_columns(block=pl.col("world") + pl.col("replicate").cast(pl.String)).to_pandas()
    own = by_term(table)
    means = frame.groupby(["world", "block"])["coverage"].mean().reset_index()
    between = anova_lm(ols("coverage ~ C(world)", means).fit(), typ=2)
    assert own["world"]["f"] == pytest.approx(between["F"].iloc[0])
    assert own["world"]["p"] == pytest.approx(between["PR(>F)"].iloc[0])
    pairs = ("C(world):C(traffic)", "C(world):C(policy)", "C(traffic):C(policy)")
    for name in ("C(traffic)", "C(policy)", *pairs):
        rest = ["C(block)", *(other for other in ("C(traffic)", "C(policy)") if other != name)]
        rest += [pair for pair in pairs if name not in pair and pair != name]
        assert own[theirs(name)]["ss"] == pytest.approx(left(frame, rest) - left(frame, [*rest, name])), name
    assert own["replicate"]["ss"] + own["world"]["ss"] == pytest.approx(left(frame, ["1"]) - left(frame, ["C(block)"]))
    assert (own["world"]["df"], own["replicate"]["df"], own["world × policy"]["df"]) == (1, 12, 2)


def test_shares_of_the_variance_sum_to_one() -> None:
    for table in (study(PAPER, 5, some_effects), study({**SMALL, "world": ("north", "south")}, 4)):
        shares = effects(table, FACTORS).drop_nulls("eta2").group_by("metric").agg(pl.col("eta2").sum())
        assert shares["eta2"].to_list() == pytest.approx([1.0] * shares.height)
        assert effects(table, FACTORS)["eta2"].min() >= 0


def test_no_effect_is_found_where_cells_share_one_unusual_recording() -> None:
    """Tested against the residual, traffic would be found in most of these studies."""
    levels = {**PAPER, "altitude_m": (6.0, 10.0)}
    p = [effects(study(levels, 10, seed=seed), FACTORS, MAIN) for seed in range(120)]
    found = pl.concat(p).group_by("term").agg((pl.col("p") < 0.05).mean().alias("rate")).drop_nulls()
    rates = dict(found.iter_rows())
    assert set(rates) == {
        "traffic",
        "altitude_m",
        "policy",
        "traffic × altitude_m",
        "traffic × policy",
        "altitude_m × policy",
    }
    assert max(rates.values()) <= stats.binom.ppf(0.999, 120, 0.05) / 120
    assert np.mean(list(rates.values())) == pytest.approx(0.05, abs=0.03)


def test_partial_omega_is_the_share_of_the_effect_among_the_means_of_its_cells() -> None:
    """Against what the means are made of: in `study` a replicate differs from traffic to traffic by 0.04 × 0.5, and
    each mission by as much again, of which twelve are averaged; altitudes differ by the noise of missions alone."""
    low, steep = 0.03, 0.004
    table = study(
        PAPER, 400, lambda cell: {"coverage": low * (cell["traffic"] == "low") + steep * float(cell["altitude_m"])}
    )
    own = by_term(table)
    mission = (0.04 * 0.5) ** 2
    for term, levels, error in (
        ("traffic", [low, 0.0, 0.0], mission + mission / 12),
        ("altitude_m", [steep * each for each in (6.0, 10.0, 15.0)], mission / 12),
    ):
        made = float(np.var(levels))
        assert own[term]["omega2"] == pytest.approx(made / (made + error), abs=0.04), term


def test_factors_with_one_level_are_dropped() -> None:
    assert set(by_term(study())) == {"traffic", "policy", "traffic × policy", "replicate", "residual"}


def test_only_whole_replicates_are_used() -> None:
    table = study()
    gone = without(table, (pl.col("replicate") == 4) & (pl.col("policy") == "micro"), failed=True)
    gone = without(gone, pl.col("replicate") == 7, failed=False)
    whole = table.filter(~pl.col("replicate").is_in([4, 7]))
    assert by_term(gone)["traffic"] == pytest.approx(by_term(whole)["traffic"])
    assert by_term(gone)["traffic"]["replicates"] == 18


def test_a_level_that_always_failed_is_left_out() -> None:
    gone = without(study(), pl.col("policy") == "micro", failed=True)
    assert by_term(gone) == by_term(study().filter(pl.col("policy") != "micro"))


def test_a_cell_that_always_failed_leaves_nothing_to_say() -> None:
    gone = without(study(), (pl.col("policy") == "micro") & (pl.col("traffic") == "high"), failed=True)
    assert effects(gone, FACTORS, MAIN).height == 0


def test_a_single_replicate_is_described_and_not_tested() -> None:
    own = effects(study(replicates=1), FACTORS, MAIN)
    assert own.select("f", "p", "omega2").null_count().row(0) == (own.height,) * 3
    assert own["eta2"].sum() == pytest.approx(1.0)


def test_equal_values_explain_nothing() -> None:
    own = effects(study().with_columns(coverage=pl.lit(0.7)), FACTORS, MAIN)
    assert own.select("f", "p", "eta2").null_count().row(0) == (own.height,) * 3
