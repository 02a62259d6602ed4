"""How likely entries show a defect: the regression, the share of defects, and what uses them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from shapely import Point, box

from pavetwin.detections import NO_DETECTIONS
from pavetwin.errors import PaveTwinError
from pavetwin.inventory.entry import Entry, entry_model, with_probabilities
from pavetwin.inventory.entry_fit import JudgedEntry, JudgedInventory, fit_entries, judged_inventory
from pavetwin.inventory.files import write_inventory
from pavetwin.inventory.of_mission import flown
from pavetwin.inventory.reading import Reading, entries_of
from pavetwin.mission.saving import save_mission
from pavetwin.sensing.fitted_sensor import OF_ENTRY, EntryModel, FittedNumber, SensorModel, entry_values
from pavetwin.world.georeference import anchored
from scenes import fitted
from scenes.observed import entry_of, observed
from scenes.spots import Spot, fly_over_spots
from scenes.tiny import Scene, straight

BETA = {"pothole": -1.0, "single_crack": -2.0, "confidence": 1.5, "looks": 0.8, "size": 0.6}
SEVERITIES = {"pothole": (0.5, 0.3, 0.2), "single_crack": (0.8, 0.2, 0.0)}
HERE = anchored(52.5, 13.4)


def model(share: float = 0.5) -> EntryModel:
    terms = {name: FittedNumber(estimate=value, standard_error=0.1) for name, value in BETA.items()}
    return EntryModel(terms=terms, entries=100, defect_share=share, severities=SEVERITIES)


def entry(confidence: float = 0.6, looks: int = 2, side_px: float = 32.0, kind: str = "pothole") -> Entry:
    shape = box(0, 0, 0.01 * side_px, 0.01 * side_px)
    return entry_of(1, [observed(kind, confidence, str(number), shape, pixel_m=0.01) for number in range(looks)])


def drawn(count: int, levels: dict[str, float], seed: int = 0) -> list[JudgedEntry]:
    """Entries by the regression, with these levels of the classes."""
    rng, rows = np.random.default_rng(seed), []
    for _ in range(count):
        kind = str(rng.choice(["pothole", "single_crack"]))
        confidence, looks, size_px = rng.uniform(0.25, 0.95), int(rng.integers(1, 6)), float(rng.uniform(5, 120))
        score = levels[kind] + sum(
            BETA[name] * value for name, value in zip(OF_ENTRY, entry_values(confidence, looks, size_px), strict=True)
        )
        rows.append(JudgedEntry(kind, confidence, looks, size_px, bool(rng.uniform() < 1 / (1 + np.exp(-score)))))
    return rows


def test_the_fit_recovers_stated_effects_within_their_errors() -> None:
    made = fit_entries([JudgedInventory(tuple(drawn(4000, BETA)), (("pothole", "low"),) * 7)])
    assert made is not None
    for name, value in BETA.items():
        assert made.terms[name].estimate == pytest.approx(value, abs=3.5 * made.terms[name].standard_error)
        assert 0.0 < made.terms[name].standard_error < 0.2
    assert made.severities["pothole"] == pytest.approx((0.8, 0.1, 0.1))
    assert made.severities["single_crack"] == pytest.approx((1 / 3,) * 3)


def test_missions_with_the_same_entries_count_once_and_a_class_that_is_always_right_is_left_out() -> None:
    rows = drawn(300, BETA)
    right = JudgedEntry("crocodile_crack", 0.9, 2, 60.0, is_defect=True)
    one = JudgedInventory((*rows, right), ())
    made = fit_entries([one, one])
    assert made is not None
    assert made.entries == 300
    assert made.chance("crocodile_crack", 0.9, 2, 60.0) is None
    assert fit_entries([JudgedInventory((right,), ())]) is None


def test_surer_larger_and_repeated_entries_are_more_likely_defects() -> None:
    usual, better = model().chance("pothole", 0.5, 2, 30.0), (("pothole", 0.8, 2, 30.0), ("pothole", 0.5, 4, 30.0))
    assert usual is not None
    for each in (*better, ("pothole", 0.5, 2, 60.0)):
        chance = model().chance(*each)
        assert chance is not None
        assert usual < chance < 1.0
    assert model().chance("pothole", 0.5, 2, 32.0) == pytest.approx(1 / (1 + np.exp(1.0 - 0.8)))
    assert model().chance("ravelling", 0.5, 2, 30.0) is None


@pytest.mark.parametrize("share", [0.1, 0.5, 0.85])
def test_the_share_of_defects_follows_from_the_entries_themselves(share: float) -> None:
    """Entries as those that the sensor was fitted to, but with more or fewer false alarms among them."""
    pool = drawn(6000, BETA)
    base = float(np.mean([each.is_defect for each in pool]))
    right, wrong = ([each for each in pool if each.is_defect == is_defect] for is_defect in (True, False))
    rows = [*right[: round(600 * share)], *wrong[: round(600 * (1 - share))]]
    listed = [entry(each.confidence, each.looks, each.size_px, each.kind) for each in rows]
    judged = [each.probability or 0.0 for each in with_probabilities(listed, model(base))]
    assert np.mean(judged) == pytest.approx(share, abs=0.04)
    fitted_to = [model().chance(each.kind, each.confidence, each.looks, each.size_px) or 0.0 for each in rows]
    if share != 0.5:
        assert abs(np.mean(fitted_to) - share) > 0.08


def test_what_has_no_place_or_another_class_has_no_probability() -> None:
    without = replace(entry(), outline=None)
    judged = with_probabilities([without, entry(kind="Ravelling"), entry()], model())
    assert [each.probability is None for each in judged] == [True, True, False]
    assert with_probabilities([], model()) == []


def test_entries_that_are_less_likely_defects_are_listed_and_do_not_count_in_the_index(tmp_path: Path) -> None:
    placed = [replace(each, place=Point(0.2, 0.2)) for each in (entry(), entry(), entry())]
    judged = [replace(each, probability=chance) for each, chance in zip(placed, (0.49, 0.5, None), strict=True)]
    assert [each.is_likely for each in judged] == [False, True, True]
    write_inventory(judged, Reading(NO_DETECTIONS, HERE, 1), tmp_path)
    assert pl.read_csv(tmp_path / "inventory.csv")["probability"].to_list() == [0.49, 0.5, None]


def test_a_severity_that_images_leave_open_counts_by_the_frequencies_of_the_class() -> None:
    (known,) = with_probabilities([entry()], model())
    assert [*known.severities.values()] == pytest.approx([0.5, 0.3, 0.2])
    assert [*entry().severities.values()] == pytest.approx([1 / 3] * 3)
    assert [*replace(known, severity="medium to high").severities.values()] == pytest.approx([0.6, 0.4])


def test_entries_of_a_mission_are_judged_by_its_matching_and_by_the_sensor_of_its_detector(tmp_path: Path) -> None:
    scene = Scene(straight((12.0, 1.0), (30.0, 0.0)), altitude_m=10.0)
    spots: list[Spot] = [("pothole", each.polygon) for each in scene.world.defects]
    ghost = ("pothole", straight((45, 0)).defects[0].polygon)
    result, _ = fly_over_spots(scene, [*spots, ghost], aboard=False)
    save_mission(result, tmp_path / "m")
    judged = judged_inventory(tmp_path / "m")
    assert sorted(each.is_defect for each in judged.entries) == [False, True, True]
    assert [kind for kind, _ in judged.severities] == ["pothole"] * 2
    reading = flown(tmp_path / "m")
    assert reading.detector is not None
    sensor = fitted.stated().model_copy(update={"entries": model()})
    of_it = sensor.detector.model_copy(update={"sha256": reading.detector})
    file = tmp_path / "sensor.json"
    sensor.model_copy(update={"detector": of_it}).save(file)
    assert SensorModel.read(file).entries == model()
    found = entries_of(flown(tmp_path / "m", fitted=str(file)))
    assert all(each.probability is not None for each in found)
    sensor.save(file)
    with pytest.raises(PaveTwinError, match=r"`fitted` '.*' was fitted for another detector than that"):
        flown(tmp_path / "m", fitted=str(file))
    with pytest.raises(PaveTwinError, match="no detector searched these images"):
        entry_model(None, str(file))
    sensor.model_copy(update={"detector": of_it, "entries": None}).save(file)
    with pytest.raises(PaveTwinError, match="has no model of entries"):
        flown(tmp_path / "m", fitted=str(file))
