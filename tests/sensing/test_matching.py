"""Which defect a detection means: hand-made boxes with known answers, and the laws of the measures."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from pavetwin.defects import DEFECT_CLASSES, defect_class
from pavetwin.defects.pothole import pothole as pothole_shape
from pavetwin.defects.pothole import sample_pothole_poses
from pavetwin.defects.severity import pothole_severity
from pavetwin.sensing import Detections, Frame, match
from pavetwin.sensing.matching import iou, placed, shared_extent
from pavetwin.sensing.sensor import trial_defect, trial_frames
from pavetwin.world.model import Defect

FRAME: Frame = replace(trial_frames(1)[0], position=(0.0, 0.0), yaw_rad=0.0, altitude_m=10.0)


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    shape = shapely.box(x0, y0, x1, y1)
    assert isinstance(shape, Polygon)
    return shape


def defect(number: int, kind: str, shape: Polygon) -> Defect:
    return replace(trial_defect(number), id=number, kind=kind, polygon=shape, centre=shape.centroid)


def overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return float(iou(np.array(a), np.array([b]))[0])


POTHOLE = defect(0, "pothole", box(0, 0, 1, 1))
CRACK = defect(1, "single_crack", box(-2, -1.0, 1, -0.97))


def pothole(x0: float, y0: float, x1: float, y1: float, confidence: float = 0.9) -> Detections:
    return Detections(["pothole"], confidence, footprint=[box(x0, y0, x1, y1)])


def matched(detections: Detections, *defects: Defect) -> list[tuple[int, bool]]:
    """The index of each detection's defect, −1 for none, and whether it is the first."""
    found = match(FRAME, detections, defects)
    return [*zip(found.defect.tolist(), found.is_first.tolist(), strict=True)]


def test_half_of_the_union_is_enough_and_less_is_not() -> None:
    # Shifted by s along one side of a unit square, IoU = (1 − s) / (1 + s): 0.5 at s = 1/3.
    near, far = pothole(0.33, 0, 1.33, 1), pothole(0.34, 0, 1.34, 1)
    assert matched(near, POTHOLE) == [(0, True)]
    assert matched(far, POTHOLE) == [(-1, False)]


def test_another_class_at_the_same_place_matches_nothing() -> None:
    wrong = Detections(["crocodile_crack"], 0.9, footprint=[POTHOLE.polygon])
    assert matched(wrong, POTHOLE) == [(-1, False)]


def test_each_defect_is_matched_first_by_the_most_confident_detection() -> None:
    first, second = pothole(0, 0, 1, 1, 0.4), pothole(0.05, 0, 1.05, 1, 0.8)
    assert matched(Detections.concatenated([first, second]), POTHOLE) == [(0, False), (0, True)]


def test_two_detections_between_two_defects_take_one_each() -> None:
    other = defect(2, "pothole", box(0.2, 0, 1.2, 1))
    both = Detections.concatenated([pothole(0.1, 0, 1.1, 1, 0.9), pothole(0.12, 0, 1.12, 1, 0.5)])
    found = matched(both, POTHOLE, other)
    assert sorted(index for index, _ in found) == [0, 1]
    assert all(is_first for _, is_first in found)


def test_a_thin_crack_is_matched_by_its_extent_on_the_ground() -> None:
    """A box next to a 3 m crack of 3 cm: no IoU to speak of, but it lies along it."""
    beside = Detections(["single_crack"], 0.9, footprint=[box(-1, -0.93, 1, -0.9)])
    assert overlap(FRAME.box_of(beside.footprint[0]), FRAME.box_of(CRACK.polygon)) < 0.3
    assert matched(beside, CRACK) == [(0, True)]
    away = Detections(["single_crack"], 0.9, footprint=[box(-1, -0.8, 1, -0.77)])
    assert matched(away, CRACK) == [(-1, False)]
    behind = Detections(["single_crack"], 0.9, footprint=[box(0.6, -1.0, 1.6, -0.97)])
    assert matched(behind, CRACK) == [(-1, False)]  # shares 0.4 m of 1 m


@pytest.fixture
def own_classes() -> Iterator[None]:
    for name, is_thin in (("hairline", True), ("stripe", False)):
        defect_class(
            name,
            sample_poses=sample_pothole_poses,
            rate=pothole_severity,
            width=lambda _: 0.0,
            weight=1.0,
            is_thin=is_thin,
        )(pothole_shape)
    yield
    for name in ("hairline", "stripe"):
        DEFECT_CLASSES.restore(name, None)


@pytest.mark.usefixtures("own_classes")
@pytest.mark.parametrize(("kind", "found"), [("hairline", (0, True)), ("stripe", (-1, False)), ("odd", (-1, False))])
def test_an_own_class_is_thin_where_it_is_declared_so(kind: str, found: tuple[int, bool]) -> None:
    """The last is of a world whose classes were not registered here."""
    beside = Detections([kind], 0.9, footprint=[box(-1, -0.93, 1, -0.9)])
    assert matched(beside, replace(CRACK, kind=kind)) == [found]


@pytest.mark.usefixtures("own_classes")
def test_sensors_are_tried_on_every_registered_class() -> None:
    shown = {sighting.defect.kind for each in trial_frames() for sighting in each.sightings}
    assert shown == set(DEFECT_CLASSES.names()) > {"hairline", "single_crack"}


def test_a_box_in_the_image_means_the_ground_under_it() -> None:
    from_image = Detections(["pothole"], 0.9, box_px=[FRAME.box_of(POTHOLE.polygon)])
    assert matched(from_image, POTHOLE) == [(0, True)]
    assert placed(from_image, FRAME).footprint[0].symmetric_difference(POTHOLE.polygon).area < 1e-6


def test_the_image_box_follows_camera_height_and_yaw() -> None:
    # The paper's camera: 60° over 950 rows, so 10 m up a metre is 950 / (20 tan 30°) px.
    scale = 950 / (20 * np.tan(np.radians(30)))
    left, top, right, bottom = FRAME.box_of(POTHOLE.polygon)
    assert (right - left, bottom - top) == pytest.approx((scale, scale))
    # The image's upper edge points east: east is up, north is to the left.
    assert (left, bottom) == pytest.approx((1270 / 2 - scale, 950 / 2))
    turned = replace(FRAME, yaw_rad=np.pi / 2)
    assert turned.box_of(POTHOLE.polygon)[0] == pytest.approx(1270 / 2)


side = st.floats(0, 100)
boxes = st.tuples(side, side, side, side).map(
    lambda b: (min(b[0], b[2]), min(b[1], b[3]), max(b[0], b[2]), max(b[1], b[3]))
)


@given(boxes, boxes)
def test_iou_is_a_symmetric_share(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    assert overlap(a, b) == pytest.approx(overlap(b, a))
    assert 0.0 <= overlap(a, b) <= 1.0 + 1e-9
    area = (a[2] - a[0]) * (a[3] - a[1])
    if area > 1e-6:
        assert overlap(a, a) == pytest.approx(1.0)


@given(st.floats(-np.pi, np.pi), st.floats(0.2, 5.0), st.floats(0.0, 1.0))
def test_the_shared_extent_does_not_depend_on_the_cracks_direction(yaw: float, length: float, share: float) -> None:
    crack = box(0, -0.01, length, 0.01)
    other = box(length * share, 0.02, length * (1 + share), 0.05)
    turned = [shapely.affinity.rotate(shape, yaw, origin=(0, 0), use_radians=True) for shape in (other, crack)]
    assert shared_extent(turned[0], turned[1]) == pytest.approx(1 - share, abs=0.06 / length + 1e-6)
