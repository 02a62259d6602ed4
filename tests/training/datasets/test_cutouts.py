"""Objects cut out of pictures, and those that are not."""

import numpy as np
import pytest

from pavetwin.arrays import UInt8Array
from pavetwin.labels.common_form import AnnotatedImage, Annotation
from pavetwin.training.datasets.cutouts import CutOut, cut_outs, ground_resolution
from scenes.photographs import pavement, with_car

SIZE = (200, 150)
BOX = (50, 60, 100, 80)
CAR = Annotation("Car", BOX)


def image_of(*annotations: Annotation, gsd_mm: float | None = None) -> AnnotatedImage:
    return AnnotatedImage("a", ".jpg", SIZE, "s", "a.jpg", "s:a", gsd_mm=gsd_mm, annotations=annotations)


def found(picture: UInt8Array, *annotations: Annotation, gsd_mm: float | None = None) -> tuple[list[CutOut], list[str]]:
    """The cut-outs, and why others are none."""
    reasons: list[str] = []
    return list(cut_outs(image_of(*annotations, gsd_mm=gsd_mm), picture, reasons.append)), reasons


def car(angle_deg: float = 0.0) -> UInt8Array:
    return with_car(pavement(SIZE), (75, 70), 50, angle_deg)


def test_a_car_is_cut_out_of_its_box() -> None:
    (cut,), _ = found(car(), CAR)
    drawn = (np.abs(car().astype(int) - pavement(SIZE)).sum(axis=2) > 60)[60:81, 50:101]
    opaque = np.argwhere(cut.pixels[..., 3] > 0)
    assert np.ptp(opaque, axis=0) == pytest.approx((20, 50), abs=2)
    assert opaque.shape[0] == pytest.approx(drawn.sum(), rel=0.06)
    assert (cut.length_px, cut.width_px) == (pytest.approx(50, abs=2), pytest.approx(20, abs=2))
    assert cut.surroundings == pytest.approx((120, 120, 120), abs=2)
    red, green, _ = cut.pixels[cut.pixels[..., 3] > 0][:, :3].mean(axis=0)
    assert red > 2 * green


@pytest.mark.parametrize("angle", [-60.0, 30.0, 85.0])
def test_its_angle_is_that_of_its_length(angle: float) -> None:
    picture = car(angle)
    rows, columns = np.nonzero(np.abs(picture.astype(int) - pavement(SIZE)).sum(axis=2) > 60)
    box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
    (cut,), _ = found(picture, Annotation("Car", box))
    assert cut.angle_deg == pytest.approx(angle, abs=4)


def test_the_ground_resolution_is_stated_or_that_of_a_usual_car() -> None:
    cuts, _ = found(car(), CAR)
    assert ground_resolution(image_of(), cuts) == pytest.approx(90, rel=0.06)
    assert ground_resolution(image_of(gsd_mm=70), cuts) == 70
    assert ground_resolution(image_of(), []) is None


def test_an_outline_is_taken_as_it_is() -> None:
    outline = ((52.0, 62.0), (99.0, 62.0), (99.0, 79.0), (52.0, 79.0))
    (cut,), _ = found(car(), Annotation("Car", (52, 62, 99, 79), outline=outline))
    assert (cut.pixels[..., 3] > 0).sum() == 47 * 17


@pytest.mark.parametrize(
    ("picture", "annotations", "gsd_mm", "reason"),
    [
        (with_car(pavement(SIZE), (10, 70), 50), (Annotation("Car", (0, 60, 35, 80)),), None, "touches the border"),
        (car(), (CAR, Annotation("Person", (90, 60, 110, 80), "hidden")), None, "another object is before or behind"),
        (car(), (Annotation("Car", (40, 40, 130, 110)),), None, "does not reach the sides of its box"),
        (car(), (Annotation("Car", (70, 66, 80, 74)),), None, "too small"),
        (car(), (CAR,), 300.0, "has not the size of its class on the ground"),
        (pavement(SIZE), (CAR,), None, ""),
        (car(), (Annotation("Car", BOX, attributes={"visible_fraction": "0.9"}),), None, "a part of it is hidden"),
    ],
)
def test_a_bad_cut_out_is_rejected_with_its_reason(
    picture: UInt8Array, annotations: tuple[Annotation, ...], gsd_mm: float | None, reason: str
) -> None:
    cuts, reasons = found(picture, *annotations, gsd_mm=gsd_mm)
    assert cuts == []
    assert reason in reasons[0]


def test_other_classes_and_ignored_objects_are_no_cut_outs() -> None:
    assert found(car(), Annotation("Pothole", BOX), Annotation("Car", (100, 100, 150, 120), "hidden")) == ([], [])
