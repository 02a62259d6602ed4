"""Suppression of duplicate boxes and of parts of an object."""

from math import exp

import numpy as np
import pytest
from hypothesis import given

from pavetwin.labels.class_names import CLASSES
from pavetwin.perception.detector import Detector
from pavetwin.perception.suppression import lowering, whole_objects
from scenes.drawn_detector import FILE
from scenes.rows_of_boxes import Row, arrays_of, rows

CRACK, POTHOLE, PERSON, CAR = (CLASSES.index(name) for name in ("single_crack", "pothole", "person", "car"))
CELLS = 28


def kept(*said: Row, masks: np.ndarray | None = None) -> list[int]:
    return whole_objects(*arrays_of(said), masks).tolist()


def slanting() -> np.ndarray:
    """From the upper left to the lower right, two cells wide."""
    return (np.eye(CELLS) + np.eye(CELLS, k=1)).astype(np.float32).clip(0, 1)


CAR_BOX = (100.0, 100.0, 300.0, 200.0)


def test_a_wheel_is_no_second_car_and_who_stands_before_a_car_is_a_person() -> None:
    wheel = (110.0, 150.0, 150.0, 199.0)
    assert kept((CAR, CAR_BOX), (CAR, wheel), (PERSON, wheel)) == [0, 2]
    assert kept((CAR, wheel), (CAR, CAR_BOX)) == [0, 1]  # a doubtful whole takes nothing from a sure part


@pytest.mark.parametrize(("left", "rows"), [(91.0, [0]), (89.0, [0, 1])])
def test_what_stands_out_by_more_than_a_tenth_is_an_object_of_its_own(left: float, rows: list[int]) -> None:
    assert kept((CAR, CAR_BOX), (CAR, (left, 120.0, left + 100.0, 180.0))) == rows


def test_what_is_dropped_takes_no_others_with_it() -> None:
    half = (100.0, 100.0, 195.0, 205.0)
    beyond = (150.0, 150.0, 194.0, 204.9)  # lies in the half, and less than nine tenths of it in the whole
    outer = (100.0, 100.0, 300.0, 197.0)
    assert kept((CAR, outer), (CAR, half)) == [0]
    assert kept((CAR, half), (CAR, beyond)) == [0]
    assert kept((CAR, outer), (CAR, half), (CAR, beyond)) == [0, 2]


def test_a_pothole_in_a_pothole_is_one_and_in_a_network_is_a_pothole() -> None:
    crocodile = CLASSES.index("crocodile_crack")
    inner = (150.0, 120.0, 180.0, 140.0)
    assert kept((POTHOLE, CAR_BOX), (POTHOLE, inner)) == [0]
    assert kept((crocodile, CAR_BOX), (POTHOLE, inner)) == [0, 1]


def test_half_of_a_crack_is_a_part_and_a_crack_beside_it_is_not() -> None:
    whole, half = (0.0, 0.0, 280.0, 280.0), (0.0, 0.0, 140.0, 140.0)
    beside = (150.0, 10.0, 270.0, 60.0)  # above the diagonal
    masks = np.stack([slanting(), slanting(), np.ones((CELLS, CELLS), dtype=np.float32)])
    cracks = ((CRACK, whole), (CRACK, half), (CRACK, beside))
    assert kept(*cracks, masks=masks) == [0, 2]
    assert kept(*cracks) == [0, 1, 2]  # nothing tells them apart
    masks[1] = 0
    assert kept(*cracks, masks=masks) == [0, 1, 2]


@given(rows(POTHOLE, PERSON, CAR))
def test_the_first_stays_no_part_stays_and_a_second_pass_changes_nothing(
    drawn: list[Row],
) -> None:
    stay = kept(*drawn)
    assert stay[:1] == [0] * bool(drawn)
    assert kept(*[drawn[at] for at in stay]) == list(range(len(stay)))
    for at in set(range(len(drawn))) - set(stay):
        assert any(
            share(drawn[at][1], drawn[o][1]) >= 0.9 - 1e-9 and drawn[o][0] == drawn[at][0] for o in stay if o < at
        )


def share(part: tuple[float, ...], whole: tuple[float, ...]) -> float:
    across, down = (max(0.0, min(part[k + 2], whole[k + 2]) - max(part[k], whole[k])) for k in (0, 1))
    return across * down / ((part[2] - part[0]) * (part[3] - part[1]))


def test_a_detector_says_no_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    detector = Detector(FILE, confidence=0.2, tiled=False)
    side = detector.image_px
    boxes = np.array([[0, 0, 40, 30], [2, 2, 20, 20], [2, 2, 20, 20]], dtype=np.float32)
    outputs = {
        "image": np.zeros(3, dtype=np.int64),
        "boxes": boxes,
        "classes": np.array([CAR, CAR, PERSON]),
        "detection": np.array([0.6, 0.9, 0.5], dtype=np.float32),
        "subtype": np.array([1.0, 0.5, 1.0], dtype=np.float32),
        "masks": np.zeros((3, CELLS, CELLS), dtype=np.float32),
    }
    monkeypatch.setattr(detector, "_outputs", lambda _: dict(outputs))
    (found,) = detector.detect([np.zeros((side, side, 3), dtype=np.uint8)])
    assert found.class_number.tolist() == [CAR, PERSON]
    assert found.confidence.tolist() == pytest.approx([0.6, 0.5])


def factors(*said: Row) -> list[float]:
    return lowering(*arrays_of(said)).tolist()


FIRST = (0.0, 0.0, 100.0, 100.0)
AGAIN = (0.0, 50.0, 100.0, 150.0)
"""IoU with the first 1/3."""
BEHIND = (0.0, 100.0, 100.0, 200.0)
"""IoU with the second 1/3, with the first 0."""


def test_a_second_box_says_less_and_boxes_of_other_classes_the_same() -> None:
    assert factors((PERSON, FIRST), (PERSON, AGAIN)) == pytest.approx([1, exp(-2 / 9)])
    assert factors((PERSON, FIRST), (CAR, AGAIN)) == [1, 1]
    assert factors((PERSON, FIRST), (PERSON, FIRST)) == pytest.approx([1, exp(-2)])
    assert factors() == []


def test_what_is_lowered_itself_lowers_others_less() -> None:
    assert factors((PERSON, AGAIN), (PERSON, BEHIND)) == pytest.approx([1, exp(-2 / 9)])
    assert factors((PERSON, FIRST), (PERSON, AGAIN), (PERSON, BEHIND)) == pytest.approx([1, exp(-2 / 9), 1])


@given(rows(PERSON, CAR))
def test_none_is_raised_none_is_silenced_and_who_stands_apart_stays(
    drawn: list[Row],
) -> None:
    told = factors(*drawn)
    assert all(exp(-2) - 1e-9 <= each <= 1 for each in told)
    for at, (each, box) in enumerate(drawn):
        surer = [other for kind, other in drawn[:at] if kind == each]
        if not any(min(box[2], o[2]) > max(box[0], o[0]) and min(box[3], o[3]) > max(box[1], o[1]) for o in surer):
            assert told[at] == 1
    # What is less sure has no say.
    assert factors(*drawn[:-1]) == pytest.approx(told[:-1])


def test_a_detector_sorts_by_what_is_left_and_drops_what_falls_below_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    detector = Detector(FILE, confidence=0.3, tiled=False)
    side = detector.image_px
    boxes = np.array([[0, 0, 40, 40], [0, 10, 40, 50], [0, 14, 40, 54], [60, 0, 90, 40]], dtype=np.float32)
    outputs = {
        "image": np.zeros(4, dtype=np.int64),
        "boxes": boxes,
        "classes": np.array([CAR, CAR, CAR, CAR]),
        "detection": np.array([0.9, 0.8, 0.4, 0.5], dtype=np.float32),
        "subtype": np.ones(4, dtype=np.float32),
        "masks": np.zeros((4, 28, 28), dtype=np.float32),
    }
    monkeypatch.setattr(detector, "_outputs", lambda _: {name: values.copy() for name, values in outputs.items()})
    (found,) = detector.detect([np.zeros((side, side, 3), dtype=np.uint8)])
    assert found.box_px.tolist() == boxes[[0, 3, 1]].tolist()
    assert found.confidence.tolist() == pytest.approx([0.9, 0.5, 0.8 * exp(-2 * 0.6**2)])
