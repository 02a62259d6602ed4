"""Boxes that overlap a surer one of their class: a second box of a person says less, who stands beside one does not."""

from math import exp

import numpy as np
import pytest
from hypothesis import given

from pavetwin.labels.class_names import CLASSES
from pavetwin.perception.detector import Detector
from pavetwin.perception.suppression import lowering
from scenes.drawn_detector import FILE
from scenes.rows_of_boxes import Row, arrays_of, rows

PERSON, CAR = (CLASSES.index(name) for name in ("person", "car"))


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
    told = {
        "image": np.zeros(4, dtype=np.int64),
        "boxes": boxes,
        "classes": np.array([CAR, CAR, CAR, CAR]),
        "detection": np.array([0.9, 0.8, 0.4, 0.5], dtype=np.float32),
        "subtype": np.ones(4, dtype=np.float32),
        "masks": np.zeros((4, 28, 28), dtype=np.float32),
    }
    monkeypatch.setattr(detector, "_told", lambda _: {name: values.copy() for name, values in told.items()})
    (found,) = detector.detect([np.zeros((side, side, 3), dtype=np.uint8)])
    assert found.box_px.tolist() == boxes[[0, 3, 1]].tolist()
    assert found.confidence.tolist() == pytest.approx([0.9, 0.5, 0.8 * exp(-2 * 0.6**2)])
