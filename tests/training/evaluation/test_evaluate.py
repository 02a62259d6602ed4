"""Evaluations of hand-made cases with known answers."""

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pavetwin.errors import PaveTwinError
from pavetwin.training.evaluation.breakdowns import SeverityAgreement
from pavetwin.training.evaluation.detections import FoundBox, read_detections, read_subtypes
from pavetwin.training.evaluation.evaluate import DetectorEvaluation, compare_in_pairs, evaluate
from pavetwin.training.evaluation.labelled import read_split
from pavetwin.training.evaluation.resampling import metrics_of
from pavetwin.training.evaluation.scores import weighted_precision
from scenes.detections import (
    BOX,
    CAR,
    CRACK,
    CROCODILE,
    FAR,
    PERSON,
    POTHOLE,
    RUT,
    said,
    scene,
    true,
    write_detections,
    write_labels,
)

BACKGROUND = 5


def evaluated(folder: Path, images: Any, rows: Any, resamples: int = 0, **options: Any) -> DetectorEvaluation:
    return evaluate(*scene(folder, images, rows, **options), resamples=resamples)


def counts(found: DetectorEvaluation, category: int) -> tuple[int, int, int]:
    """Objects, hits and false alarms of a class at the stated confidence."""
    each = found.at_stated.classes[category - 1]
    return each.objects, each.hits, each.false_alarms


def test_perfect_detections(tmp_path: Path) -> None:
    every = [true(category, (20.0 * category, 10.0, 15.0, 60.0)) for category in (1, 2, 3, 4, 5)]
    rows = [said(1, each["category_id"], each["bbox"]) for each in every]
    found = evaluated(tmp_path, [every, []], rows)
    means = found.five.mean_precision(), found.five.mean_precision(0), found.coarse.mean_precision(0)
    assert means == pytest.approx((1.0, 1.0, 1.0))
    assert (found.at_stated.precision, found.at_stated.recall, found.at_stated.f1) == (1.0, 1.0, 1.0)
    assert found.subtypes_matched.macro_f1 == found.subtypes_matched.accuracy == 1.0
    assert found.subtypes_matched.regions == 3
    assert found.confusion.tolist() == np.diag([1, 1, 1, 1, 1, 0]).tolist()
    assert found.reliability.error == pytest.approx(0.1)


def test_nothing_said(tmp_path: Path) -> None:
    found = evaluated(tmp_path, [[true(CRACK), true(CAR, FAR)], []], [])
    assert found.five.mean_precision(0) == found.at_stated.recall == found.at_stated.f1 == 0.0
    assert found.at_stated.precision == 0.0
    assert found.at_stated.classes[0].precision is None
    assert found.confusion[0, BACKGROUND] == found.confusion[4, BACKGROUND] == 1
    assert found.subtypes_matched.macro_f1 is None
    assert found.reliability.error is None


def test_all_background(tmp_path: Path) -> None:
    """No object at all: false alarms are counted, and what needs an object is undefined."""
    found = evaluated(tmp_path, [[], []], [said(1, CRACK), said(2, CAR, FAR), said(2, CAR)])
    assert counts(found, CAR) == (0, 0, 2)
    assert np.isnan(found.five.mean_precision(0))
    assert found.at_stated.f1 is None
    assert found.at_stated.classes[4].precision == 0.0
    assert found.confusion[BACKGROUND].tolist() == [1, 0, 0, 0, 2, 0]


def test_duplicates_are_false_alarms(tmp_path: Path) -> None:
    rows = [said(1, POTHOLE, det=0.9), said(1, POTHOLE, det=0.8)]
    found = evaluated(tmp_path, [[true(POTHOLE), true(POTHOLE, FAR)]], rows)
    assert counts(found, POTHOLE) == (2, 1, 1)
    assert found.five.classes[2].average_precision[0] == pytest.approx(51 / 101)
    assert found.confusion[2, [2, BACKGROUND]].tolist() == [1, 1]
    assert found.confusion[BACKGROUND, 2] == 1


def test_a_wrong_subtype_on_a_right_box(tmp_path: Path) -> None:
    found = evaluated(tmp_path, [[true(CRACK), true(POTHOLE, FAR)]], [said(1, CROCODILE), said(1, POTHOLE, FAR)])
    assert found.coarse.mean_precision(0) == 1.0
    assert found.five.mean_precision(0) == pytest.approx(0.5)
    assert counts(found, CRACK) == (1, 0, 0)
    assert counts(found, CROCODILE) == (0, 0, 1)
    assert found.subtypes_matched.counts.tolist() == [[0, 1, 0], [0, 0, 0], [0, 0, 1]]
    assert found.subtypes_matched.macro_f1 == pytest.approx(0.5)
    assert found.subtypes_matched.accuracy == pytest.approx(0.5)
    assert found.confusion[0, 1] == 1


@pytest.mark.parametrize("region", [true(CRACK, FAR, ignored=True), true(RUT, FAR)], ids=["iscrowd", "own class"])
def test_ignored_regions_are_neither_rewarded_nor_punished(tmp_path: Path, region: Any) -> None:
    part = (110.0, 105.0, 10.0, 10.0)
    rows = [said(1, CRACK, det=0.8), said(1, CRACK, part if region["iscrowd"] else FAR, det=0.9)]
    found = evaluated(tmp_path, [[true(CRACK), region]], rows)
    assert found.five.classes[0].average_precision[0] == pytest.approx(1.0)
    assert counts(found, CRACK) == (1, 1, 0)
    assert found.confusion.sum() == 1
    assert found.reliability.detections == 1


def test_a_defect_of_an_own_class_is_a_road_defect(tmp_path: Path) -> None:
    found = evaluated(tmp_path, [[true(RUT)]], [said(1, CRACK)])
    assert found.coarse.classes[0].average_precision[0] == pytest.approx(1.0)
    assert found.subtypes_matched.regions == 0


def test_the_final_confidence_is_the_product_for_defects_only(tmp_path: Path) -> None:
    rows = [said(1, CRACK, det=0.4, cls=0.5), said(1, CAR, FAR, det=0.4)]
    del rows[0]["score"], rows[1]["score"]
    found = evaluated(tmp_path, [[true(CRACK), true(CAR, FAR)]], rows)
    assert [box.confidence for box in found.five.found] == [0.2, 0.4]
    assert counts(found, CRACK) == (1, 0, 0)
    assert counts(found, CAR) == (1, 1, 0)
    assert found.subtypes_matched.regions == 1


def test_regions_below_the_confidence_have_no_subtype(tmp_path: Path) -> None:
    rows = [said(1, CRACK, det=0.24), said(1, POTHOLE, FAR, det=0.26)]
    found = evaluated(tmp_path, [[true(CRACK), true(POTHOLE, FAR)]], rows)
    assert found.subtypes_matched.counts.tolist() == [[0, 0, 0], [0, 0, 0], [0, 0, 1]]


def test_the_best_confidence_is_chosen_on_the_validation_split(tmp_path: Path) -> None:
    """False alarms of 0.3 in its images, and a car of 0.6: from 0.6 on all is right. The test split decides nothing."""
    write_labels(tmp_path, [[true(CAR)], []], split="val")
    write_labels(tmp_path, [[true(CAR)]])
    rows = [said(501, CAR, det=0.6), said(501, CAR, FAR, det=0.3), said(1, CAR, det=0.5), said(1, CAR, FAR, det=0.9)]
    test, validation = read_split(tmp_path, "test"), read_split(tmp_path, "val")
    found = read_detections(write_detections(tmp_path / "found.json", rows), (test, validation))
    result = evaluate(test, found, validation=validation, resamples=0)
    assert result.total == 2
    assert result.at_best is not None
    assert result.at_best.confidence == 0.6
    assert result.at_best.f1 == 0.0
    assert result.at_stated.f1 == pytest.approx(2 / 3)
    only = [each for each in found if each.image == 1]
    assert evaluate(test, only, validation=validation, resamples=0).at_best is None


def test_subtypes_on_true_regions(tmp_path: Path) -> None:
    split, found = scene(tmp_path, [[true(CRACK), true(POTHOLE, FAR), true(CAR), true(CRACK, ignored=True)]], [])
    rows = [{"annotation_id": 10_000, "category_id": CRACK}, {"annotation_id": 10_001, "category_id": CROCODILE}]
    told = read_subtypes(write_detections(tmp_path / "regions.json", rows), split)
    scores = evaluate(split, found, subtypes=told, resamples=0).subtypes_true
    assert scores is not None
    assert scores.counts.tolist() == [[1, 0, 0], [0, 0, 0], [0, 1, 0]]
    with pytest.raises(PaveTwinError, match=r"has no entry for 1 of 2 defects, such as 10001"):
        read_subtypes(write_detections(tmp_path / "regions.json", rows[:1]), split)


def test_breakdowns(tmp_path: Path) -> None:
    images = [
        [true(CRACK, visible_fraction=0.6, contrast=25.0), true(CAR, (100, 100, 10, 10), visible_fraction=1.0)],
        [true(CRACK, visible_fraction=1.0, contrast=90.0)],
    ]
    facts = [
        {"camera": {"altitude_m": 6.0}, "gsd_mm": 2.0, "light": {"sun_elevation_deg": 20.0, "cloud_cover": 0.9}},
        {"attributes": {"altitude_m": "10.0"}, "gsd_mm": 5.0},
    ]
    rows = [said(1, CRACK), said(2, CRACK, FAR), said(2, CRACK, det=0.2)]
    found = evaluated(tmp_path, images, rows, facts=facts)
    table = {(row.name, row.values): row for row in found.breakdowns}
    low, high = table["altitude_m", "4–8 m"], table["altitude_m", "8–12 m"]
    assert (low.images, low.objects, low.hits, low.recall, low.precision) == (1, 2, 1, 0.5, 1.0)
    assert low.average_precision == pytest.approx(0.5)
    assert (high.recall, high.precision) == (0.0, 0.0)
    assert high.average_precision == pytest.approx(0.5)
    assert table["gsd_mm", "1.5–3 mm/px"].objects == 2
    assert table["sun_elevation_deg", "15–30 °"].images == table["cloud_cover", "from 70 %"].images == 1
    assert (table["visible_fraction", "50–80 %"].recall, table["visible_fraction", "from 99 %"].recall) == (1.0, 0.0)
    assert table["contrast", "20–35"].hits == 1
    assert table["size_px", "below 16 px"].hits == 0
    assert table["size_px", "below 16 px"].average_precision is None


def test_calibration_by_hand(tmp_path: Path) -> None:
    """Two of 0.85, one right; one of 0.35, right: (2 · 0.35 + 0.65) / 3."""
    rows = [said(1, CAR, det=0.85), said(1, CAR, FAR, det=0.85), said(2, CAR, det=0.35)]
    found = evaluated(tmp_path, [[true(CAR)], [true(CAR)]], rows)
    assert found.reliability.error == pytest.approx((2 * 0.35 + 0.65) / 3)
    bins = [(each.detections, each.precision) for each in found.reliability.bins if each.detections]
    assert bins == [(1, 1.0), (2, 0.5)]


def test_sizes_against_what_captures_know(tmp_path: Path) -> None:
    whole = {"visible_fraction": 1.0, "inside_fraction": 1.0, "area_m2": 2.0}
    images = [
        [true(POTHOLE, **whole), true(POTHOLE, FAR, **{**whole, "inside_fraction": 0.5})],
        [true(POTHOLE, **whole)],
    ]
    rows = [said(1, POTHOLE, area_m2=2.2), said(1, POTHOLE, FAR, area_m2=9.0), said(2, POTHOLE, area_m2=1.4)]
    (row,) = evaluated(tmp_path, images, rows).sizes
    assert (row.size, row.name, row.defects) == ("area_m2", "Pothole", 2)
    assert row.mean_absolute_percentage == pytest.approx(20.0)
    assert row.bias_percentage == pytest.approx(-10.0)


def test_widths_and_diameters_follow_from_area_and_length(tmp_path: Path) -> None:
    """A crack of 2 m with an outline of 0.1 m² is 50 mm wide; a pothole of π/4 m² has a diameter of 1 m."""
    whole = {"visible_fraction": 1.0, "inside_fraction": 1.0}
    images = [[true(CRACK, area_m2=0.1, length_m=2.0, **whole), true(POTHOLE, FAR, area_m2=np.pi / 4, **whole)]]
    rows = [
        said(1, CRACK, area_m2="not resolvable", length_m=1.8, mean_width_mm=60.0),
        said(1, POTHOLE, FAR, diameter_mm=900.0),
    ]
    found = {(row.size, row.name): row.bias_percentage for row in evaluated(tmp_path, images, rows).sizes}
    expected = {
        ("length_m", "Single Crack"): -10,
        ("mean_width_mm", "Single Crack"): 20,
        ("diameter_mm", "Pothole"): -10,
    }
    assert found == {key: pytest.approx(value) for key, value in expected.items()}


def test_severities_against_what_captures_know(tmp_path: Path) -> None:
    """One is right, one is right or higher, one is said too low, one too high, one not at all, and one not whole."""
    whole = {"visible_fraction": 1.0, "inside_fraction": 1.0}
    pairs = [
        ("medium", "medium"), ("medium", "medium to high"), ("high", "low to medium"), ("low", "medium"),
        ("low", "not resolvable"), ("high", ""),
    ]  # fmt: skip
    images: list[Any] = [[true(POTHOLE, severity=severity, **whole)] for severity, _ in pairs]
    images.append([true(POTHOLE, severity="low", visible_fraction=0.5, inside_fraction=1.0)])
    told = [*(words for _, words in pairs), "low"]
    rows = [said(at, POTHOLE, severity=words) for at, words in enumerate(told, start=1)]
    (row,) = evaluated(tmp_path, images, rows).severities
    assert row == SeverityAgreement("Pothole", 5, right=1, within=1, too_low=1, too_high=1, not_resolvable=1)


@pytest.mark.parametrize("words", ["severe", "medium to low", "low to medium to high", "low to high", "low to low", 3])
def test_a_severity_that_is_none_is_refused(tmp_path: Path, words: Any) -> None:
    with pytest.raises(PaveTwinError, match=rf"entry 1 has a severity '{words}'; it is low, medium, high, low to"):
        evaluated(tmp_path, [[true(POTHOLE)]], [said(1, POTHOLE, severity=words)])


def some(
    rng: np.random.Generator, images: int, classes: int = RUT
) -> tuple[list[list[dict[str, Any]]], list[dict[str, Any]]]:
    """Objects and detections of all kinds."""
    every, rows = [], []
    for image in range(1, images + 1):
        objects = []
        for _ in range(int(rng.integers(0, 5))):
            box = [*rng.uniform(0, 120, 2), *rng.uniform(6, 60, 2)]
            objects.append(true(int(rng.integers(1, classes + 1)), box, ignored=bool(rng.random() < 0.2)))
        for each in objects * 2:
            moved = np.array(each["bbox"]) + rng.normal(0, 3, 4)
            moved[2:] = np.maximum(moved[2:], 1)
            category = (
                each["category_id"] if rng.random() < 0.8 and each["category_id"] < 6 else int(rng.integers(1, 6))
            )
            rows.append(said(image, category, moved.tolist(), float(rng.random()), float(rng.random())))
        every.append(objects)
    return every, rows


@pytest.mark.parametrize("seed", range(3))
def test_it_agrees_with_the_published_evaluation_of_the_same_files(tmp_path: Path, seed: int) -> None:
    """And so does what the bootstrap computes, where each image is there once, or twice."""
    split, found = scene(tmp_path, *some(np.random.default_rng(seed), 20, classes=CAR))
    result = evaluate(split, found, resamples=0)
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO(tmp_path / "annotations" / "instances_test.json")
        judge = COCOeval(truth, truth.loadRes(str(tmp_path / "found.json")), "bbox")
        judge.params.catIds = [1, 2, 3, 4, 5]
        judge.evaluate()
        judge.accumulate()
        judge.summarize()
    assert result.five.mean_precision() == pytest.approx(judge.stats[0], abs=1e-9)
    assert result.five.mean_precision(0) == pytest.approx(judge.stats[1], abs=1e-9)
    for each in result.five.classes:
        for weight in (1.0, 2.0):
            weights = np.full(len(split.images), weight)
            assert weighted_precision(each, weights) == pytest.approx(each.average_precision, abs=1e-9)


def test_a_draw_is_the_evaluation_of_the_images_drawn(tmp_path: Path) -> None:
    """Images drawn 0, 1 or 2 times weigh as a split in which they stand so often."""
    images, rows = some(np.random.default_rng(8), 10)
    times = [0, 1, 2, 1, 0, 2, 1, 1, 0, 2]
    split, found = scene(tmp_path, images, rows)
    matched = evaluate(split, found, resamples=0)
    drawn = [at for at, count in enumerate(times) for _ in range(count)]
    again = [{**row, "image_id": to} for to, at in enumerate(drawn, 1) for row in rows if row["image_id"] == at + 1]
    whole = evaluate(*scene(tmp_path / "drawn", [images[at] for at in drawn], again), resamples=0)
    value = metrics_of(matched.five, matched.coarse, 0.25)(np.array(times, dtype=np.float64))
    assert value == pytest.approx({name: each.value for name, each in whole.intervals.items()}, nan_ok=True)
    assert value["map50"] == pytest.approx(whole.five.mean_precision(0))
    assert value["f1"] == pytest.approx(whole.at_stated.f1)
    assert value["precision"] == pytest.approx(whole.at_stated.precision)


def test_intervals_hold_their_values_and_need_a_seed(tmp_path: Path) -> None:
    split, found = scene(tmp_path, *some(np.random.default_rng(3), 25))
    one, other, same = (evaluate(split, found, resamples=60, seed=seed).intervals for seed in (0, 1, 0))
    assert one == same != other
    assert one["map50"].low < one["map50"].value < one["map50"].high
    assert one["map50"].high - one["map50"].low < 0.6


def test_images_of_one_group_are_drawn_together(tmp_path: Path) -> None:
    """All images in one group: each draw is the whole split, and the interval has no width."""
    images, rows = some(np.random.default_rng(3), 6)
    split, found = scene(tmp_path, images, rows, facts=[{"group": "bridge"}] * 6)
    interval = evaluate(split, found, resamples=20).intervals["map50"]
    assert interval.low == pytest.approx(interval.value)
    assert interval.high == pytest.approx(interval.value)


def test_two_files_are_compared_on_the_same_draws(tmp_path: Path) -> None:
    """The second finds one car more of every ten: a small difference, and no draw on which it is not there or 0."""
    images = [[true(CAR)] for _ in range(40)]
    split, first = scene(tmp_path, images, [said(at, CAR) for at in range(1, 41) if at % 2])
    second = (
        *first,
        *read_detections(write_detections(tmp_path / "b.json", [said(4 * at, CAR) for at in range(1, 6)]), (split,)),
    )
    compared = compare_in_pairs(split, [first], [second], resamples=200)
    assert (compared.first[0]["recall"], compared.second[0]["recall"]) == pytest.approx((20 / 40, 25 / 40))
    found = compared.differences["recall"]
    assert found.value == pytest.approx(5 / 40)
    assert 0.0 < found.low < found.value < found.high < 0.3
    assert found.p < 0.05
    nothing = compare_in_pairs(split, [first], [first], resamples=50).differences["map50"]
    assert (nothing.value, nothing.low, nothing.high, nothing.p) == (0.0, 0.0, 0.0, 1.0)


def test_the_spread_between_runs_is_in_the_interval_of_a_difference(tmp_path: Path) -> None:
    """All images are of one group, so that their draws change nothing: runs of recall 0.5 and 0.7 against 0.4."""
    images, facts = [[true(CAR)] for _ in range(10)], [{"group": "bridge"}] * 10

    def found(name: str, cars: int) -> tuple[FoundBox, ...]:
        rows = [said(at, CAR) for at in range(1, cars + 1)]
        return read_detections(write_detections(tmp_path / f"{name}.json", rows), (split,))

    split, other = scene(tmp_path, images, [said(at, CAR) for at in range(1, 5)], facts=facts)
    runs = [found("a", 5), found("b", 7)]
    recall = compare_in_pairs(split, [other], runs, resamples=100).differences["recall"]
    assert (recall.value, recall.low, recall.high) == pytest.approx((0.2, 0.1, 0.3))
    alone = compare_in_pairs(split, [other], runs[:1], resamples=100).differences["recall"]
    assert (alone.value, alone.low, alone.high) == pytest.approx((0.1, 0.1, 0.1))
    same = compare_in_pairs(split, runs, runs[::-1], resamples=100).differences["recall"]
    assert same.value == pytest.approx(0)
    assert (same.low, same.high) == pytest.approx((-0.2, 0.2), abs=0.06)


def test_classes_that_a_source_does_not_label_are_left_out(tmp_path: Path) -> None:
    images = [[true(CRACK)], [true(PERSON)]]
    facts = [{"source": "roads"}, {"source": "people"}]
    folder = write_labels(tmp_path, images, facts=facts)
    path = folder / "annotations" / "instances_test.json"
    path.write_text(path.read_text().replace("PaveTwin synthetic images", "photographs"))
    split = read_split(folder, "test")
    rows = [said(1, CRACK), said(1, PERSON, FAR), said(2, PERSON), said(2, POTHOLE, FAR)]
    found = evaluate(split, read_detections(write_detections(tmp_path / "f.json", rows), (split,)), resamples=0)
    assert (found.total, found.unlabelled) == (4, 2)
    assert [counts(found, category)[2] for category in (CRACK, POTHOLE, PERSON)] == [0, 0, 0]


def test_a_class_that_was_pasted_counts_where_it_was_pasted(tmp_path: Path) -> None:
    images = [[true(CRACK), true(CAR, FAR, attributes={"cut_out": "of another image"})], [true(CRACK, FAR)]]
    folder = write_labels(tmp_path, images, facts=[{"source": "roads"}] * 2)
    path = folder / "annotations" / "instances_test.json"
    path.write_text(path.read_text().replace("PaveTwin synthetic images", "photographs"))
    split = read_split(folder, "test")
    rows = [said(1, CAR, FAR), said(2, CAR)]
    found = evaluate(split, read_detections(write_detections(tmp_path / "f.json", rows), (split,)), resamples=0)
    assert (found.total, found.unlabelled) == (2, 1)
    assert counts(found, CAR) == (1, 1, 0)


@pytest.mark.parametrize(
    ("values", "message"), [({"confidence": 1.5}, "`confidence` 1.5"), ({"resamples": -1}, "`resa")]
)
def test_values_out_of_bounds_are_refused(tmp_path: Path, values: Any, message: str) -> None:
    with pytest.raises(PaveTwinError, match=message):
        evaluate(*scene(tmp_path, [[true(CAR, BOX)]], []), **values)
