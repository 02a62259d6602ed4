"""Looks at one defect: each finds it with exactly its chance, and what one missed the next is likely to miss too."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm
from shapely import Point

from pavetwin.config import load_settings
from pavetwin.config.mission import SensingSettings
from pavetwin.errors import PaveTwinError
from pavetwin.sensing import Recall, Sighting
from pavetwin.sensing.sensor import trial_defect, trial_frames

DEFECTS = 3000
BLANK = trial_frames(1)[0]


def seen(number: int, look: int) -> Sighting:
    """A look at a whole pothole, identified by its outline."""
    pothole = replace(trial_defect(2), id=number, polygon=Point(number, 0).buffer(0.2, quad_segs=1))
    return Sighting(pothole, 1.0, look, across_m=0.4)


def hits(sensor: Recall, *sightings: Sighting) -> list[bool]:
    """For each look, True if it finds its defect."""
    reported = set(map(id, sensor.detect(replace(BLANK, sightings=sightings)).footprint))
    return [id(sighting.defect.polygon) in reported for sighting in sightings]


def recall_with(recall: float, correlation: float, seed: int = 0) -> Recall:
    """The sensor where size does not matter."""
    return Recall(SensingSettings(recall=recall, look_correlation=correlation, least_px=None), seed)


@cache
def found(correlation: float, recall: float) -> np.ndarray:
    """(DEFECTS, 3) whether each look finds each defect."""
    one = recall_with(recall, correlation)
    return np.array([hits(one, *(seen(number, look) for number in range(DEFECTS))) for look in range(3)]).T


def tolerance(share: float) -> float:
    return 4 * (share * (1 - share) / DEFECTS) ** 0.5


@pytest.mark.parametrize("recall", [0.2, 0.84])
@pytest.mark.parametrize("correlation", [0.3, 0.8, 1.0])
def test_a_single_look_finds_with_exactly_its_chance(correlation: float, recall: float) -> None:
    for look in (0, 2):
        assert found(correlation, recall)[:, look].mean() == pytest.approx(recall, abs=tolerance(recall))


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.8, 0.99])
@pytest.mark.parametrize("recall", [0.2, 0.84])
def test_two_looks_agree_as_often_as_their_correlation(correlation: float, recall: float) -> None:
    """Against the bivariate normal distribution: both find it with Φ₂(Φ⁻¹(p), Φ⁻¹(p); ρ)."""
    law = multivariate_normal([0, 0], [[1, correlation], [correlation, 1]])
    expected = float(law.cdf([norm.ppf(recall)] * 2))
    for first, second in ((0, 1), (1, 2)):
        both = found(correlation, recall)[:, first] & found(correlation, recall)[:, second]
        assert both.mean() == pytest.approx(expected, abs=tolerance(expected))


def test_with_full_correlation_every_look_finds_the_same() -> None:
    outcomes = found(1.0, 0.84)
    assert (outcomes == outcomes[:, :1]).all()


@given(st.floats(0.05, 0.95), st.floats(0.0, 1.0), st.integers(0, 10**6))
def test_a_higher_recall_never_loses_a_look_under_the_same_draws(recall: float, correlation: float, seed: int) -> None:
    looks = [seen(3, look) for look in range(4)]
    less = [hits(recall_with(recall, correlation, seed), look)[0] for look in looks]
    more = [hits(recall_with(min(1.0, recall + 0.05), correlation, seed), look)[0] for look in looks]
    assert all(later or not earlier for earlier, later in zip(less, more, strict=True))


def test_a_draw_depends_on_seed_defect_and_look_alone() -> None:
    """Common random numbers: not on what was shown before, nor on what else is shown."""
    looks = [seen(number, look) for number in range(40) for look in (2, 0, 1)]
    alone = [hits(recall_with(0.5, 0.8, 4), look)[0] for look in looks]
    one = recall_with(0.5, 0.8, 4)
    assert hits(one, *looks[::-1])[::-1] == alone
    assert hits(recall_with(0.5, 0.8, 5), *looks) != alone


def test_the_paper_draws_every_attempt_by_itself_and_does_not_count_pixels() -> None:
    paper, default = load_settings("paper").sensing, load_settings().sensing
    assert (paper.look_correlation, paper.least_px) == (0.0, None)
    assert default == SensingSettings()
    assert default.look_correlation == 0.8


def test_a_class_that_is_set_leaves_the_others_as_they_are_and_an_unknown_one_is_refused() -> None:
    given = load_settings(overrides=["sensing.least_px.single_crack=4"]).sensing.least_px
    assert given == {"single_crack": 4, "crocodile_crack": 16, "pothole": 8}
    with pytest.raises(PaveTwinError, match=r"sensing\.least_px: no defect class 'pothol'.*did you mean 'pothole'"):
        Recall(SensingSettings(least_px={"pothol": 3}), 0)
