"""The uncertainty of a fitted sensor in studies: its columns, and what it does to intervals and advice."""

from typing import Any

import numpy as np
import polars as pl
import pytest

from pavetwin.config.mission import SensingSettings
from pavetwin.experiments.metrics import COVERAGE_DRAWS
from pavetwin.experiments.statistics import MissionLimits, recommend
from pavetwin.experiments.tours import by_mission
from pavetwin.mission.fly import fly_over
from pavetwin.sensing.calibrated import Calibrated
from pavetwin.sensing.fit.fitting import found_by_draws
from pavetwin.sensing.fitted_sensor import SensorModel
from pavetwin.sensing.frame import Look
from pavetwin.sensing.sensor import trial_frames
from scenes.fitted import stated
from scenes.studies import PAPER, study
from scenes.tiny import Scene, straight

LEVELS = {**PAPER, "traffic": ("low",), "altitude_m": (6.0, 15.0), "policy": ("hover",)}


def found_less(cell: dict[str, Any]) -> dict[str, float]:
    return {"coverage": 0.0 if cell["altitude_m"] == 6.0 else -0.06}


def with_draws(table: pl.DataFrame, errors: dict[float, float]) -> pl.DataFrame:
    """A study in which draws of the sensor's parameters move the coverage of an altitude by a standard deviation."""
    steps = np.linspace(-1, 1, len(COVERAGE_DRAWS)) * 1.7
    shift = pl.col("altitude_m").replace_strict(errors, return_dtype=pl.Float64)
    return table.with_columns(
        (pl.col("coverage") + float(step) * shift).alias(name) for name, step in zip(COVERAGE_DRAWS, steps, strict=True)
    )


def width(table: pl.DataFrame, altitude_m: float = 6.0) -> float:
    options = recommend(table, MissionLimits()).options.filter(altitude_m=altitude_m)
    return float((options["coverage_high"] - options["coverage_low"])[0])


def test_a_sensor_that_is_sure_changes_nothing() -> None:
    table = study(LEVELS, 12, found_less)
    sure = with_draws(table, {6.0: 0.0, 15.0: 0.0})
    assert width(sure) == pytest.approx(width(table))
    plain, other = recommend(table, MissionLimits()), recommend(sure, MissionLimits())
    assert other.best is not None
    assert plain.best is not None
    assert other.best["certainty"] == plain.best["certainty"]


def test_intervals_hold_the_sensors_error_which_more_replicates_do_not_reduce() -> None:
    few, many = study(LEVELS, 12, found_less), study(LEVELS, 60, found_less)
    errors = {6.0: 0.05, 15.0: 0.0}
    assert width(many) < 0.55 * width(few)
    assert width(with_draws(many, errors)) > 2 * 1.9 * 0.05
    assert width(with_draws(few, errors)) > width(with_draws(many, errors))
    assert width(with_draws(many, errors), 15.0) == pytest.approx(width(many, 15.0))


def test_a_sensor_that_is_unsure_of_a_difference_makes_the_advice_unsure() -> None:
    table = study(LEVELS, 60, found_less)
    common = recommend(with_draws(table, {6.0: 0.1, 15.0: 0.1}), MissionLimits()).best
    apart = recommend(with_draws(table, {6.0: 0.0, 15.0: 0.1}), MissionLimits()).best
    assert common is not None
    assert apart is not None
    assert common["certainty"] > 0.95
    assert 0.5 < apart["certainty"] < 0.9


def test_tours_have_the_draws_by_defects() -> None:
    table = with_draws(study(LEVELS, 3), {6.0: 0.1, 15.0: 0.0}).head(2)
    whole = dict.fromkeys(("mission_time_s", "mission_energy", "mission_distance_m", "mission_batteries"), 1.0)
    sums = dict.fromkeys(("length_m", "area_m2", "swept", "confirmed", "recovered", "revisits"), 1.0)
    rows = table.with_columns(
        *(pl.lit(value).alias(name) for name, value in (whole | sums).items()),
        *(pl.lit(0.0).alias(name) for name in ("duplicates", "false_alarms", "permanently_hidden")),
        replicate=0,
        defects=pl.Series([1, 3]),
        order=pl.Series([0, 1]),
    )
    columns = rows.columns
    before = [*columns[: columns.index("replicate") + 1], "status", "reason", "order"]
    made = by_mission(rows.select(*before, *(name for name in columns if name not in before)))
    name = COVERAGE_DRAWS[0]
    assert made[name].to_list() == pytest.approx([(rows[name][0] + 3 * rows[name][1]) / 4])


def look(number: int) -> Look:
    return Look("pothole", "medium", 2.0, 50.0 + number, 8.0, 1.0, 1.0, 0.1, 0.5, 40.0, 0.1)


def test_the_chance_of_looks_together_is_that_of_the_model() -> None:
    model = stated(spread=1.5, error=1e-9)
    rng = np.random.default_rng(0)
    looks = [look(0), look(20), look(60)]
    scores = [sum(model.terms[name].estimate * value for name, value in model.row(each).items()) for each in looks]
    latent = np.array(scores) + 1.5 * rng.standard_normal((100_000, 1)) + rng.standard_normal((100_000, 3))
    found = found_by_draws(model, [looks, [], looks[:1], [look(0)._replace(kind="ravelling")]])
    assert found.shape == (len(COVERAGE_DRAWS), 4)
    assert found[:, 0] == pytest.approx((latent > 0).any(axis=1).mean(), abs=0.005)
    assert found[:, 2] == pytest.approx(model.chance(looks[0]), abs=1e-6)
    assert (found[:, [1, 3]] == 0).all()
    unsure = found_by_draws(stated(spread=1.5, error=0.3), [looks])
    assert unsure.std() > 0.02


def test_a_mission_tells_the_expected_coverage_of_what_it_looked_at() -> None:
    scene = Scene(straight((12, 0), (30, 0), (45, -1.5)), altitude_m=6.0)
    settings = scene.settings()
    model: SensorModel = stated(error=1e-9)
    shares, expected = [], 0.0
    for seed in range(40):
        eyes = Calibrated(SensingSettings(sensor="calibrated"), seed, model)
        result = fly_over(scene.environment(settings), scene.traffic(), settings, [0], "baseline", sensor=eyes)
        shares.append(len(result.memory.confirmed) / 3)
        expected = float(eyes.found_by_draws([0, 1, 2]).mean())
    assert np.mean(shares) == pytest.approx(expected, abs=4 * np.std(shares) / 40**0.5 + 0.01)
    assert 0 < expected < 1


def test_before_any_look_nothing_is_found() -> None:
    eyes = Calibrated(SensingSettings(sensor="calibrated"), 0, stated())
    assert (eyes.found_by_draws([0, 1]) == 0).all()
    for frame in trial_frames(4):
        eyes.detect(frame)
    assert eyes.found_by_draws([frame.defect.id for frame in trial_frames(4)[1].sightings]).min() > 0
