"""The camera of a proposal: its pixel on the ground, and the defects that it cannot show."""

import pytest

from pavetwin.experiments.advice import advise, ground_view
from pavetwin.experiments.statistics import MissionLimits
from scenes.studies import SMALL, study

HIGH = {"altitude_m": 120.0, "preset": "default", "sensor": "recall"}
PAPERS_CAMERA = {"set": {"camera.model": "paper"}}


def test_from_120_m_the_papers_camera_shows_no_crack() -> None:
    view = ground_view(HIGH, PAPERS_CAMERA)
    assert 1000 * view.pixel_m == pytest.approx(145.9, abs=0.1)
    assert view.unseen_m["single_crack"] == pytest.approx(2 * view.pixel_m, rel=1e-3)
    assert view.sentence == (
        "From 120 m with the camera paper a pixel covers 146 mm: cracks thinner than 292 mm, crocodile cracks narrower "
        "than 2.3 m and potholes narrower than 1.2 m are not seen from here."
    )


def test_an_aircraft_brings_its_camera() -> None:
    assert ground_view(HIGH, {"set": {"aircraft": "phantom4pro"}}).camera == "phantom4pro"


def test_camera_limits_and_blur_are_those_of_the_design() -> None:
    low = {**HIGH, "altitude_m": 10.0}
    sharp = ground_view(low, {"set": {"camera.model": "phantom4pro", "camera.exposure_s": 0.0001}})
    assert 1000 * sharp.pixel_m == pytest.approx(2.74, abs=0.01)
    assert sharp.blur_px == pytest.approx(2.5 * 0.0005 / sharp.pixel_m), "no shorter than its shutter can"
    blurred = ground_view(low, {"set": {"camera.model": "phantom4pro", "camera.exposure_s": 0.004}})
    assert blurred.unseen_m["single_crack"] > 3 * sharp.unseen_m["single_crack"]
    assert blurred.unseen_along_m["single_crack"] == pytest.approx(2 * blurred.pixel_m), "blur lies along these cracks"
    assert "cracks across the flight thinner than 21 mm (along it 5.5 mm), crocodile" in blurred.sentence
    swept = {"sweep": {"camera.model": ["paper", "phantom4pro"], "sensing.least_px.single_crack": [4]}}
    chosen = ground_view({**low, "camera.model": "phantom4pro", "sensing.least_px.single_crack": 4}, swept)
    assert chosen.camera == "phantom4pro"
    assert chosen.unseen_m["single_crack"] > 3.9 * chosen.pixel_m


@pytest.mark.parametrize("changed", [{"preset": "paper"}, {"sensor": "ideal"}])
def test_missions_that_do_not_count_pixels_say_so(changed: dict[str, str]) -> None:
    view = ground_view({**HIGH, "altitude_m": 15.0, **changed}, PAPERS_CAMERA)
    assert not view.is_counted
    assert "These missions do not count pixels: a real detector may miss cracks thinner than 3" in view.sentence


def test_advice_of_a_known_design_ends_with_the_view() -> None:
    table = study(SMALL, 8)
    (known,) = advise(table, MissionLimits(), design={"set": {"camera.model": "phantom4pro"}})
    assert known.view is not None
    assert known.sentences == (*known.recommendation.sentences, known.view.sentence)
    assert known.view.sentence.startswith("From 6 m with the camera phantom4pro a pixel covers 1.6 mm")
    (nearest,) = advise(table, MissionLimits(max_time_s=1.0), design={"name": "any"})
    assert nearest.recommendation.best is None
    assert nearest.view is not None
    (unknown,) = advise(table, MissionLimits())
    assert unknown.view is None
    assert unknown.sentences == unknown.recommendation.sentences


def test_the_assumptions_of_a_study_have_views_of_their_own() -> None:
    table = study({**SMALL, "sensor": ("ideal", "recall"), "preset": ("default",)}, 6)
    counted = [each.view.is_counted for each in advise(table, MissionLimits(), design={"name": "any"}) if each.view]
    assert counted == [False, True]
