"""What a pixel covers decides what can be found: laws of the chance of `recall`, and missions that keep them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.config.mission import SensingSettings
from pavetwin.mission.defect_files import defects_table
from pavetwin.mission.inspected_defects import MissReason, inspected_defects
from pavetwin.sensing import Recall, Sighting, smallest_extent_m
from pavetwin.sensing.conformance import trial_defect, trial_frames
from pavetwin.uav import find_camera
from pavetwin.world.model import Defect
from scenes.tiny import Scene, straight

CRACK, NETWORK, POTHOLE = KINDS = ("single_crack", "crocodile_crack", "pothole")
BLANK = trial_frames(1)[0]
PAPER = find_camera("paper")


def of(kind: str, across_m: float) -> Defect:
    """A defect of a class with this smallest extent."""
    is_crack = kind == CRACK
    ground = shapely.box(0, 0, 2.0, 0.1) if is_crack else shapely.box(0, 0, 2 * across_m, across_m)
    return replace(trial_defect(0), kind=kind, polygon=ground, width_m=across_m if is_crack else 0.01)


def chance(kind: str, across_m: float, *, speed_mps: float = 0.0, visible: float = 1.0, **frame: Any) -> float:
    """Of one look with the paper's camera from 10 m, unless `frame` says otherwise."""
    pose = {"camera": PAPER, "altitude_m": 10.0, "velocity_mps": (speed_mps, 0.0)} | frame
    sighting = Sighting(of(kind, across_m), visible, 0, across_m)
    return Recall(SensingSettings(), 0).chance(replace(BLANK, **pose), sighting)


kinds = st.sampled_from(KINDS)
sizes = st.floats(0.001, 3.0)
speeds = st.floats(0, 12)


def test_a_pixel_covers_what_the_design_says() -> None:
    """Phantom 4 Pro: 1.6, 2.7 and 4.1 mm at 6, 10 and 15 m; the paper's camera at 120 m: 146 mm."""
    pro = [1000 * find_camera("phantom4pro").ground_resolution_m(altitude_m) for altitude_m in (6, 10, 15)]
    assert pro == pytest.approx([1.6, 2.7, 4.1], abs=0.06)
    assert 1000 * PAPER.ground_resolution_m(120) == pytest.approx(145.9, abs=0.1)


def test_blur_is_speed_by_exposure_and_widens_the_pixel() -> None:
    still = replace(BLANK, camera=find_camera("phantom4pro"), velocity_mps=(0.0, 0.0))
    moving = replace(still, velocity_mps=(3.0, 4.0), exposure_s=0.001)
    assert still.blur_px == 0
    assert still.blurred_pixel_m == still.ground_resolution_m
    assert moving.blur_px * moving.ground_resolution_m == pytest.approx(0.005)
    assert moving.blurred_pixel_m == pytest.approx(np.hypot(0.005, still.ground_resolution_m))


def test_what_counts_of_a_defect_is_its_smallest_extent() -> None:
    assert smallest_extent_m(of(CRACK, 0.013)) == 0.013
    turned = shapely.affinity.rotate(shapely.box(0, 0, 0.5, 0.3), 31)
    assert smallest_extent_m(replace(of(POTHOLE, 1.0), polygon=turned)) == pytest.approx(0.3)


@pytest.mark.parametrize(("kind", "least_px"), [(CRACK, 2), (NETWORK, 16), (POTHOLE, 8)])
def test_nothing_is_seen_below_the_least_pixels_and_all_of_the_recall_is_reached_at_three_times(
    kind: str, least_px: int
) -> None:
    least_m = least_px * PAPER.ground_resolution_m(10.0)
    assert chance(kind, 0.999 * least_m) == 0
    assert 0 < chance(kind, 1.2 * least_m) < 0.84 / 4
    assert chance(kind, 2.0 * least_m) == pytest.approx(0.42)
    assert chance(kind, 3.001 * least_m) == 0.84


@given(kinds, sizes, st.floats(3, 120), st.floats(3, 120), speeds, st.floats(0.35, 1))
def test_the_chance_never_rises_with_altitude(
    kind: str, across_m: float, one_m: float, other_m: float, speed_mps: float, visible: float
) -> None:
    low, high = (
        chance(kind, across_m, altitude_m=altitude_m, speed_mps=speed_mps, visible=visible)
        for altitude_m in sorted((one_m, other_m))
    )
    assert high <= low


@given(kinds, sizes, st.floats(3, 120), st.integers(2, 6), speeds)
def test_a_camera_with_more_pixels_over_the_same_footprint_never_does_worse(
    kind: str, across_m: float, altitude_m: float, times: int, speed_mps: float
) -> None:
    width, height = PAPER.image_px
    sharper = PAPER.model_copy(update={"image_px": (width * times, height * times)})
    assert sharper.footprint_m(altitude_m) == pytest.approx(PAPER.footprint_m(altitude_m))
    pose = {"altitude_m": altitude_m, "speed_mps": speed_mps}
    assert chance(kind, across_m, camera=sharper, **pose) >= chance(kind, across_m, **pose)


@given(kinds, sizes, sizes, speeds, speeds, st.floats(1e-4, 0.02))
def test_what_is_larger_or_less_blurred_is_never_found_less_often(
    kind: str, one_m: float, other_m: float, one_mps: float, other_mps: float, exposure_s: float
) -> None:
    small, large = (chance(kind, size) for size in sorted((one_m, other_m)))
    assert small <= large
    slow, fast = (chance(kind, one_m, speed_mps=speed, exposure_s=exposure_s) for speed in sorted((one_mps, other_mps)))
    assert fast <= slow


def test_of_a_half_hidden_pothole_the_visible_part_counts_and_of_a_crack_its_width() -> None:
    pixel_m = PAPER.ground_resolution_m(10.0)
    assert 0 < chance(POTHOLE, 16 * pixel_m, visible=0.5) < chance(POTHOLE, 16 * pixel_m)
    assert chance(POTHOLE, 15.9 * pixel_m, visible=0.25) == 0
    assert chance(CRACK, 4 * pixel_m, visible=0.5) == chance(CRACK, 4 * pixel_m) > 0


# In missions.

SURE = ("sensing.sensor=recall", "sensing.recall=1")


def cracked(width_m: float, altitude_m: float = 10.0) -> Scene:
    """A street with ten cracks of one width, 2 m long."""
    world = straight(*((8.0 + 4.5 * number, 1.2) for number in range(10)))
    cracks = [
        replace(each, kind=CRACK, width_m=width_m, length_m=2.0, polygon=each.centre.buffer(1.0, quad_segs=2))
        for each in world.defects
    ]
    return Scene(replace(world, defects=tuple(cracks)), altitude_m=altitude_m)


def coverage(scene: Scene, *overrides: str) -> float | None:
    return scene.fly("baseline", *overrides).rows[0].coverage


def test_cracks_that_the_pixels_cannot_show_are_missed_for_that_reason() -> None:
    flown = cracked(0.01).fly("baseline", *SURE)
    outcomes = inspected_defects(flown)
    assert {outcome.reason for outcome in outcomes} == {MissReason.TOO_SMALL}
    assert all(outcome.captures > 0 and outcome.visible_fraction == 1 for outcome in outcomes)
    assert set(defects_table(flown)["reason"]) == {"too_small"}


def test_what_the_pixels_show_and_the_sensor_misses_is_not_called_too_small() -> None:
    outcomes = inspected_defects(cracked(0.1).fly("baseline", SURE[0], "sensing.recall=0"))
    assert {outcome.reason for outcome in outcomes} == {MissReason.NOT_RECOGNISED}


def test_wide_cracks_are_found_and_without_the_rule_thin_ones_too() -> None:
    assert coverage(cracked(0.1), *SURE) == 1
    assert coverage(cracked(0.01)) == 1, "the ideal sensor sees them"
    assert coverage(cracked(0.01), *SURE, "sensing.least_px=null") == 1


def test_motion_blur_of_a_long_exposure_loses_cracks() -> None:
    assert coverage(cracked(0.08), *SURE) == 1
    blurred = cracked(0.08).fly("baseline", *SURE, "camera.exposure_s=0.02")
    assert blurred.rows[0].coverage == 0
    assert {outcome.reason for outcome in inspected_defects(blurred)} == {MissReason.TOO_SMALL}


def test_cracks_are_not_found_from_120_m_unless_the_camera_shows_them() -> None:
    """146 mm a pixel: before pixels counted, this altitude found them all."""
    thick = cracked(0.08, altitude_m=120.0)
    assert coverage(thick, *SURE) == 0
    assert coverage(thick, *SURE, "sensing.least_px=null") == 1
    close = cracked(0.08, altitude_m=10.0)
    assert coverage(close, *SURE) == 1
