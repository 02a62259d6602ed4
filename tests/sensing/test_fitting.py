"""Fitting a sensor: stated parameters are recovered, repeated looks follow the model, and damaged files are refused."""

import json
from collections.abc import Callable
from dataclasses import replace
from math import log
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import statsmodels.api as sm
from scipy.stats import chi2

from pavetwin.errors import PaveTwinError
from pavetwin.sensing.fit.fitting import chances_of, fit_mixed_probit, fit_sensor, reliability, repeated_looks
from pavetwin.sensing.fitted_sensor import SensorModel, bend
from pavetwin.sensing.frame import Look
from scenes import drawn_detector
from scenes.fitted import FILE, drawn_looks, stated


@pytest.mark.parametrize("spread", [0.5, 1.5])
def test_the_random_effect_and_the_effects_are_recovered(spread: float) -> None:
    rng, defects, looks = np.random.default_rng(1), 500, 4
    beta = np.array([0.5, 0.8, -0.4])
    group = np.repeat(np.arange(defects), looks)
    x = np.column_stack(
        [np.ones(len(group)), rng.standard_normal(len(group)), np.repeat(rng.standard_normal(defects), looks)]
    )
    y = x @ beta + spread * np.repeat(rng.standard_normal(defects), looks) + rng.standard_normal(len(group)) > 0
    made = fit_mixed_probit(x, y, group, np.full(3, 2.5))
    wrong = np.append(made.beta, made.log_spread) - np.append(beta, log(spread))
    assert wrong @ np.linalg.solve(made.covariance, wrong) < chi2.ppf(0.99, 4)
    assert made.covariance[-1, -1] ** 0.5 < 0.25
    shuffled = rng.permutation(len(group))
    again = fit_mixed_probit(x[shuffled], y[shuffled], group[shuffled], np.full(3, 2.5))
    assert again.beta == pytest.approx(made.beta, abs=1e-3)
    assert again.log_spread == pytest.approx(made.log_spread, abs=3e-3)


def test_without_a_random_effect_it_is_the_usual_probit_regression() -> None:
    rng = np.random.default_rng(2)
    x = np.column_stack([np.ones(1500), rng.standard_normal(1500)])
    y = x @ np.array([0.3, 0.9]) + rng.standard_normal(1500) > 0
    made = fit_mixed_probit(x, y, np.repeat(np.arange(500), 3), np.full(2, 100.0))
    usual = sm.Probit(y.astype(float), x).fit(disp=0)
    assert np.exp(made.log_spread) < 0.35
    shrunk = made.beta / np.sqrt(1 + np.exp(2 * made.log_spread))
    assert shrunk == pytest.approx(usual.params, abs=0.02)


def test_a_sensor_is_recovered_from_what_it_found() -> None:
    true = stated(spread=1.2)
    fitted = fit_sensor([drawn_looks(true, 700, 4)])
    assert fitted.correlation == pytest.approx(true.correlation, abs=0.1)
    new = drawn_looks(true, 400, 1, seed=9).looks
    wrong = chances_of(fitted, new) - chances_of(true, new)
    assert abs(wrong.mean()) < 0.02
    assert np.abs(wrong).mean() < 0.05
    seen = reliability(fitted, new)
    assert (np.abs(seen.predicted - seen.observed) < 4 * seen.standard_error).all()
    alarms = fitted.false_alarms["pothole"]
    assert alarms.per_m2(0.007) == pytest.approx(0.01, rel=4 * alarms.level.standard_error)
    assert abs(alarms.slope.estimate) < 4 * alarms.slope.standard_error
    assert fitted.fitted_to.looks == 2800
    assert fitted.fitted_to.repeated == 700


def test_a_plateau_and_the_steep_fall_below_it_are_recovered() -> None:
    """A line in the logarithm of pixels cannot follow both."""
    true = stated(spread=0.5, level=2.0)
    effects = {"single_crack:size": 2.5, "single_crack:bend": -1.6}
    steep = {name: true.terms[name].model_copy(update={"estimate": effect}) for name, effect in effects.items()}
    true = true.model_copy(update={"terms": {**true.terms, **steep}})
    made = fit_sensor([drawn_looks(true, 1500, 2)])
    look = Look("single_crack", "medium", 2.0, 64.0, 8.0, 1.0, 1.0, 0.0, 0.0, None, 0.0)
    shown = [look._replace(size_px=size_px) for size_px in (16, 32, 64, 128, 256)]
    chances = [true.chance(each) for each in shown]
    assert chances == sorted(chances)
    assert chances[1] < 0.4
    assert 0.9 < chances[2] < chances[4] < 0.99
    assert [made.chance(each) for each in shown] == pytest.approx(chances, abs=0.08)
    assert made.terms["single_crack:bend"].estimate < -4 * made.terms["single_crack:bend"].standard_error


def test_the_second_term_of_the_size_is_a_natural_spline() -> None:
    knots = (3.0, 5.0, 6.0)
    assert [bend(at, knots) for at in (-4.0, 3.0)] == [0.0, 0.0]
    steps = np.diff([bend(at, knots) for at in (6.0, 7.0, 8.0, 30.0)])
    assert steps == pytest.approx([steps[0], steps[0], 22 * steps[0]])
    at = np.linspace(2.5, 6.5, 4001)
    curvature = np.diff([bend(each, knots) for each in at], 2) / 0.001**2
    assert np.abs(np.diff(curvature)).max() < 0.01  # no kink at a knot
    assert curvature.min() > -1e-3


def test_captures_that_missions_share_count_once() -> None:
    """Else the same image would be taken for looks that always agree."""
    source = drawn_looks(stated(spread=0.5), 200, 2)
    once, twice = fit_sensor([source]), fit_sensor([source, replace(source, name="another policy")])
    assert twice.fitted_to.looks == once.fitted_to.looks == 400
    assert twice.terms == once.terms
    assert twice.log_spread == once.log_spread


def test_repeated_looks_follow_the_model_and_not_independence() -> None:
    true = stated(spread=1.5)
    looks = drawn_looks(true, 900, 3, seed=3).looks
    seen = repeated_looks(true, looks, 3)
    assert [each.sum() for each in (seen.observed, seen.fitted, seen.independent)] == pytest.approx([900] * 3)

    def off(expected: np.ndarray) -> float:
        return float(((seen.observed - expected) ** 2 / expected).sum())

    assert off(seen.fitted) < chi2.ppf(0.999, 3) < 100 < off(seen.independent)


def test_false_alarms_are_those_of_a_poisson_regression() -> None:
    source = drawn_looks(stated(alarms_per_m2=0.02), 300, 1)
    made = fit_sensor([source]).false_alarms["pothole"]
    counts = np.bincount(source.alarms["image"], minlength=300)
    x = sm.add_constant(np.log2(source.images["pixel_mm"].to_numpy()))
    usual = sm.GLM(counts, x, family=sm.families.Poisson(), exposure=source.images["area_m2"].to_numpy()).fit()
    assert (made.level.estimate, made.slope.estimate) == pytest.approx(usual.params, abs=1e-3)
    assert made.slope.standard_error == pytest.approx(usual.bse[1] * max(1, usual.pearson_chi2 / 298) ** 0.5, rel=0.01)


def test_a_class_that_was_always_found_has_a_wide_error_and_no_infinite_estimate() -> None:
    source = drawn_looks(stated(), 120, 2)
    always = source.looks.with_columns(found=pl.col("found") | (pl.col("kind") == "pothole"))
    fitted = fit_sensor([replace(source, looks=always)])
    assert 1 < fitted.terms["pothole"].estimate < 8
    assert fitted.terms["pothole"].standard_error > 2 * fitted.terms["single_crack"].standard_error


def test_draws_of_the_parameters_have_their_means_and_covariance() -> None:
    model = stated(error=0.2)
    draws = model.parameter_draws(4000)
    assert draws.shape == (4000, len(model.terms) + 1)
    assert draws.mean(axis=0) == pytest.approx([*(t.estimate for t in model.terms.values()), 0.0], abs=0.02)
    assert np.cov(draws.T) == pytest.approx(np.array(model.covariance), abs=0.006)
    assert (draws == model.parameter_draws(4000)).all()


def test_a_file_is_read_back_as_it_was(tmp_path: Path) -> None:
    model = fit_sensor([drawn_looks(stated(), 60, 2)])
    model.save(tmp_path / "sensor.json")
    assert SensorModel.read(tmp_path / "sensor.json") == model
    assert max(map(len, (tmp_path / "sensor.json").read_text().splitlines())) < 400


def test_too_few_looks_and_two_detectors_are_refused() -> None:
    with pytest.raises(PaveTwinError, match=r"^9 looks, of which \d found their defect, are too few to fit a sensor"):
        fit_sensor([drawn_looks(stated(), 3, 3)])
    one, other = drawn_looks(stated(), 30, 1), drawn_looks(stated(), 30, 1, name="other")
    other = replace(other, detector=other.detector.model_copy(update={"sha256": "0" * 64}))
    with pytest.raises(PaveTwinError, match="'drawn' and 'other' were searched by different detectors"):
        fit_sensor([one, other])


def changed(change: Callable[[dict[str, Any]], object]) -> str:
    content = json.loads(FILE.read_text(encoding="utf-8"))
    change(content)
    return json.dumps(content)


DAMAGED = {
    "cut": (FILE.read_text(encoding="utf-8")[:900], "it is not JSON"),
    "other": ("[1, 2]", "it has no `pavetwin_sensor`"),
    "format": (changed(lambda c: c.update(pavetwin_sensor=2)), "has format 2"),
    "lost knots": (changed(lambda c: c["knots"].pop("pothole")), "`knots` are three rising numbers for each class"),
    "falling knots": (changed(lambda c: c["knots"]["pothole"].reverse()), "`knots` are three rising numbers"),
    "lost class": (changed(lambda c: c["terms"].pop("pothole")), "`terms` do not fit together"),
    "text": (changed(lambda c: c["terms"]["clouds"].update(estimate="much")), "terms.clouds.estimate"),
    "flat variable": (changed(lambda c: c["variables"]["blur"].update(scale=0)), "variables.blur.scale"),
    "short covariance": (changed(lambda c: c["covariance"].pop()), "`covariance` has 25 rows"),
    "negative covariance": (changed(lambda c: c["covariance"][0].__setitem__(0, -1)), "not a covariance matrix"),
    "unknown key": (changed(lambda c: c.update(colour="red")), "unknown key 'colour'"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_file_is_one_plain_line(damage: str, tmp_path: Path) -> None:
    text, message = DAMAGED[damage]
    path = tmp_path / "sensor.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PaveTwinError) as error:
        SensorModel.read(path)
    line = str(error.value)
    assert message in line
    assert str(path) in line
    assert "\n" not in line


def test_a_file_for_another_detector_is_refused(tmp_path: Path) -> None:
    assert SensorModel.read(FILE, drawn_detector.FILE) == stated()
    other = tmp_path / "other.onnx"
    other.write_bytes(b"other")
    with pytest.raises(PaveTwinError, match=r"was fitted for another detector than '.*other.onnx'.*fit it again"):
        SensorModel.read(FILE, other)
    with pytest.raises(PaveTwinError, match=r"Cannot read '.*none.json'"):
        SensorModel.read(tmp_path / "none.json")


def test_false_alarms_in_captures_that_missions_share_count_once() -> None:
    """The second mission flew the first half of the captures of the first, and others after it."""
    first, other = (drawn_looks(stated(alarms_per_m2=0.02), 200, seed) for seed in (1, 2))
    named = replace(first, images=first.images.with_columns(capture=pl.int_range(200).cast(pl.String)))
    half = named.images.head(100), named.alarms.filter(pl.col("image") < 100)
    rest = other.images.head(100).with_columns(capture=pl.int_range(200, 300).cast(pl.String))
    alarms = other.alarms.filter(pl.col("image") < 100).with_columns(pl.col("image") + 100)
    second = replace(named, images=pl.concat([half[0], rest]), alarms=pl.concat([half[1], alarms]))
    both = fit_sensor([named, second])
    alone = replace(other, images=rest, alarms=other.alarms.filter(pl.col("image") < 100), looks=other.looks.clear())
    assert both.false_alarms == fit_sensor([named, alone]).false_alarms
    assert both.fitted_to.images == 300
    unknown = [
        replace(each, images=each.images.with_columns(capture=pl.lit(None, pl.String))) for each in (named, second)
    ]
    assert fit_sensor(unknown).fitted_to.images == 400
    errors = [made.false_alarms["pothole"].level.standard_error for made in (both, fit_sensor(unknown))]
    assert errors[0] > errors[1]
