"""Sensors: the rules that all keep, and the random draws of `recall`."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import Point

from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.sensing import (
    Detections,
    Frame,
    Ideal,
    Recall,
    Sensor,
    check_sensor,
    load_sensor,
    sensor,
    sensor_names,
)
from pavetwin.sensing.sensor import trial_defect, trial_frames, trial_sighting
from scenes import drawn_detector, fitted


def frame(*sightings: tuple[int, int]) -> Frame:
    """A capture of (defect, attempt) pairs."""
    shown = tuple(
        trial_sighting(replace(trial_defect(defect), id=defect), 1.0, attempt) for defect, attempt in sightings
    )
    return replace(trial_frames(1)[0], sightings=shown)


def independent(recall: float = 0.84) -> SensingSettings:
    """Every look a draw of its own, whatever the size in pixels: as the paper has it."""
    return SensingSettings(recall=recall, look_correlation=0, least_px=None)


def reported(one: Sensor, shown: Frame) -> list[int]:
    """Ids of the sighted defects that a sensor without false alarms reports."""
    ids = {id(sighting.defect.polygon): sighting.defect.id for sighting in shown.sightings}
    return [ids[id(footprint)] for footprint in one.detect(shown).footprint]


def found(seed: int, *sightings: tuple[int, int], recall: float = 0.84) -> set[tuple[int, int]]:
    """Which sightings a fresh sensor reports."""
    confirmed = set(reported(Recall(independent(recall), seed), frame(*sightings)))
    return {sighting for sighting in sightings if sighting[0] in confirmed}


OPTIONS: dict[str, dict[str, OptionValue]] = {
    "detector": {"model": str(drawn_detector.FILE), "image_px": 64},
    "calibrated": {"fitted": str(fitted.FILE)},
}
"""Required options by sensor."""


@pytest.mark.parametrize("name", sensor_names())
def test_every_registered_sensor_keeps_the_rules(name: str) -> None:
    settings = SensingSettings(sensor=name, options=OPTIONS.get(name, {}))
    own = {"sensor": name, "options": settings.options}
    assert check_sensor(lambda given, seed: load_sensor(given.model_copy(update=own), seed)) == []
    assert load_sensor(settings, 0).name == name


class Inventive(Sensor):
    """Reports a pothole where there is none: that is a false alarm and breaks no rule."""

    def detect(self, frame: Frame) -> Detections:
        ghost = Detections(["pothole"], 0.3, footprint=[Point(frame.position).buffer(0.2)])
        found = Detections.of_defects(sighting.defect for sighting in frame.sightings)
        return Detections.concatenated([found, ghost])


class Numbering(Sensor):
    """Returns ids in place of detections."""

    def detect(self, frame: Frame) -> Detections:
        return [sighting.defect.id for sighting in frame.sightings]  # type: ignore[misc]


class Wandering(Sensor):
    """One generator for all: what it draws depends on what came before."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        super().__init__(settings, seed)
        self.random = np.random.default_rng(seed)

    def detect(self, frame: Frame) -> Detections:
        return Detections.of_defects(s.defect for s in frame.sightings if self.random.random() < self.settings.recall)


class Unseeded(Sensor):
    def detect(self, frame: Frame) -> Detections:
        return Detections.of_defects(s.defect for s in frame.sightings if np.random.default_rng().random() < 0.5)


class Falsy(Sensor):
    """The classic mistake: seed 0 is taken for no seed."""

    def detect(self, frame: Frame) -> Detections:
        draws = np.random.default_rng(self.seed or None).random(1000)
        return Detections.of_defects(s.defect for s in frame.sightings if draws[s.defect.id * 10 + s.attempt] < 0.5)


class Misspelling(Sensor):
    def detect(self, frame: Frame) -> Detections:
        outlines = [sighting.defect.polygon for sighting in frame.sightings]
        return Detections(["Pothole"] * len(outlines), 0.9, footprint=outlines)


class Failing(Sensor):
    def detect(self, frame: Frame) -> Detections:
        return Detections.of_defects([frame.sightings[0].defect])


@pytest.mark.parametrize(
    ("kind", "complaint"),
    [
        (Numbering, "which is not Detections"),
        (Wandering, "depends on what it was shown before"),
        (Unseeded, "depends on what it was shown before"),
        (Falsy, "with seed 0"),
        (Misspelling, "it reports the class 'Pothole', which is not a class of defects (did you mean 'pothole'?)"),
        (Failing, "it fails: IndexError"),
    ],
)
def test_a_bad_sensor_is_caught(kind: type[Sensor], complaint: str) -> None:
    assert any(complaint in reported for reported in check_sensor(kind))


def test_false_alarms_break_no_rule() -> None:
    assert check_sensor(Inventive) == []


def test_the_frames_that_sensors_are_tried_on_hold_none_one_and_many() -> None:
    sizes = {len(each.sightings) for each in trial_frames()}
    assert {0, 1} < sizes
    assert max(sizes) > 10
    assert {sighting.attempt for each in trial_frames() for sighting in each.sightings} >= {0, 1, 2, 3}


def test_the_ideal_sensor_confirms_all_it_is_shown() -> None:
    assert reported(Ideal(SensingSettings(), 0), frame((3, 0), (5, 2))) == [3, 5]
    assert reported(Ideal(SensingSettings(), 0), frame()) == []


def test_the_draws_are_the_defects_own_child_of_the_seed() -> None:
    for seed, defect in ((0, 0), (7, 3), (7, 4)):
        draws = child(seed, Stream.SENSING, defect).random(6)
        for attempt, draw in enumerate(draws):
            assert bool(found(seed, (defect, attempt), recall=float(draw) + 1e-9))
            assert not found(seed, (defect, attempt), recall=float(draw))


@pytest.mark.parametrize("recall", [0.0, 0.3, 0.84, 1.0])
def test_the_rate_is_the_recall(recall: float) -> None:
    count = 6000
    confirmed = reported(Recall(independent(recall), 0), frame(*((defect, 0) for defect in range(count))))
    assert len(confirmed) / count == pytest.approx(recall, abs=4 * (recall * (1 - recall) / count) ** 0.5 + 1e-12)


def test_seeds_and_attempts_are_independent() -> None:
    def outcomes(seed: int, attempt: int) -> np.ndarray:
        shown = frame(*((defect, attempt) for defect in range(4000)))
        confirmed = np.zeros(4000)
        confirmed[reported(Recall(independent(0.5), seed), shown)] = 1
        return confirmed

    zero, one, later = outcomes(0, 0), outcomes(1, 0), outcomes(0, 1)
    assert np.array_equal(zero, outcomes(0, 0))
    assert abs(np.corrcoef(zero, one)[0, 1]) < 0.06
    assert abs(np.corrcoef(zero, later)[0, 1]) < 0.06


def test_an_unknown_sensor_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(PaveTwinError, match=r"sensing\.sensor: no sensor 'recal'.*did you mean 'recall'"):
        load_sensor(SensingSettings(sensor="recal"), 0)
    with pytest.raises(ValueError, match="'ideal' is registered already"):
        sensor("ideal")(Inventive)
