"""The ground resolution decides what can be found: laws of the chance of `recall`, and missions that keep them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin._core import Captured, Occluded
from pavetwin.config.mission import SensingSettings
from pavetwin.defects.measures import orientations
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.mission.inspected_defects import MissReason, captured_frame, inspected_defects
from pavetwin.mission.mission import Mission
from pavetwin.mission.result import result_of
from pavetwin.mission.saving import defects_table
from pavetwin.policies import Displace
from pavetwin.sensing import Recall, Sighting, orientations_of, sighted_share, smallest_extent_m
from pavetwin.sensing.sensor import trial_defect, trial_frames
from pavetwin.uav import find_camera
from pavetwin.world.model import Defect
from scenes.tiny import Scene, straight, truck_beside_defects

CRACK, NETWORK, POTHOLE = KINDS = ("single_crack", "crocodile_crack", "pothole")
BLANK = trial_frames(1)[0]
PAPER = find_camera("paper")


def of(kind: str, across_m: float, turned_deg: float = 90.0) -> Defect:
    """A defect of a class with this smallest extent; a crack runs northwards unless turned otherwise from east."""
    is_crack = kind == CRACK
    ground = shapely.box(0, 0, 2.0, 0.1) if is_crack else shapely.box(0, 0, 2 * across_m, across_m)
    ground = shapely.affinity.rotate(ground, turned_deg)
    return replace(trial_defect(0), kind=kind, polygon=ground, width_m=across_m if is_crack else 0.01)


def chance(
    kind: str, across_m: float, *, speed_mps: float = 0.0, visible: float = 1.0, turned_deg: float = 90.0, **frame: Any
) -> float:
    """Chance of one look with the paper's camera from 10 m, flying east, unless `frame` has other values."""
    pose = {"camera": PAPER, "altitude_m": 10.0, "velocity_mps": (speed_mps, 0.0)} | frame
    defect = of(kind, across_m, turned_deg)
    sighting = Sighting(defect, visible, 0, across_m, orientations_of(defect))
    return Recall(SensingSettings(), 0).chance(replace(BLANK, **pose), sighting)


kinds = st.sampled_from(KINDS)
sizes = st.floats(0.001, 3.0)
speeds = st.floats(0, 12)


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


# Motion blur lies along the track of the camera.


@pytest.mark.parametrize("turned_deg", [0, 31, 90, 140, 179.9])
def test_a_thin_outline_runs_as_its_long_sides_do(turned_deg: float) -> None:
    """Its ends are left out."""
    ((east, north, share),) = orientations(of(CRACK, 0.01, turned_deg).polygon)
    assert share == 1
    assert abs(east * np.sin(np.radians(turned_deg)) - north * np.cos(np.radians(turned_deg))) < 1e-6


def test_generated_cracks_run_along_their_chord_and_wander() -> None:
    for seed in range(6):
        runs = orientations(DEFECT_CLASSES.get(CRACK).shape(seed).outline)
        assert sum(share for *_, share in runs) == pytest.approx(1)
        assert 0.01 < sum(share * north**2 for _, north, share in runs) < 0.3


@given(st.floats(0.02, 0.2), st.floats(0, 360), st.floats(0, 360), speeds, st.floats(1e-4, 0.02))
def test_a_crack_is_found_the_more_often_the_less_it_crosses_the_flight(
    width_m: float, one_deg: float, other_deg: float, speed_mps: float, exposure_s: float
) -> None:
    by_crossing = sorted((one_deg, other_deg), key=lambda angle: abs(np.sin(np.radians(angle))))
    along, across = (
        chance(CRACK, width_m, turned_deg=angle, speed_mps=speed_mps, exposure_s=exposure_s) for angle in by_crossing
    )
    assert across <= along + 1e-9


def test_along_the_flight_a_crack_is_seen_as_from_a_hover_and_across_it_with_all_of_the_blur() -> None:
    width_m = 5 * PAPER.ground_resolution_m(10.0)
    exposure_s = 2 * PAPER.ground_resolution_m(10.0) / 10.0
    along, across = (
        chance(CRACK, width_m, turned_deg=angle, speed_mps=10.0, exposure_s=exposure_s) for angle in (0.0, 90.0)
    )
    assert along == chance(CRACK, width_m)
    assert across == pytest.approx(chance(CRACK, width_m / np.hypot(1, 2)))
    assert 0 < across < 0.1 * along
    flown = {"velocity_mps": (8.0, 6.0), "exposure_s": exposure_s, "yaw_rad": 1.0}
    heading_deg = np.degrees(np.arctan2(6, 8))
    assert chance(CRACK, width_m, turned_deg=heading_deg, **flown) == pytest.approx(along), "whatever the yaw"


def test_of_a_bent_crack_the_part_that_runs_along_the_flight_is_seen() -> None:
    bent = shapely.union(shapely.box(0, 0, 2, 0.02), shapely.box(0, 0, 0.02, 1))
    defect = replace(of(CRACK, 0.02), polygon=bent)
    sighting = Sighting(defect, 1.0, 0, 0.02, orientations_of(defect))
    flying = replace(BLANK, camera=find_camera("mavic3e"), velocity_mps=(10.0, 0.0), exposure_s=0.005)
    assert sighted_share(SensingSettings(), flying, sighting) == pytest.approx(2 / 3, abs=0.02)


@pytest.mark.parametrize("kind", [POTHOLE, NETWORK])
def test_of_what_has_edges_in_all_directions_all_of_the_blur_counts(kind: str) -> None:
    size_m = (32 if kind == NETWORK else 16) * PAPER.ground_resolution_m(10.0)
    along, across = (chance(kind, size_m, speed_mps=10.0, turned_deg=angle) for angle in (0.0, 90.0))
    assert along == across < chance(kind, size_m)


# In missions.

SURE = ("sensing.sensor=recall", "sensing.recall=1")


def cracked(width_m: float, altitude_m: float = 10.0, *, along: bool = False) -> Scene:
    """A street with ten cracks of one width, 2 m long, across the street or along it."""
    world = straight(*((8.0 + 4.5 * number, 1.2) for number in range(10)))
    east_m, north_m = (1.0, 0.02) if along else (0.02, 1.0)
    cracks = [
        replace(
            each,
            kind=CRACK,
            width_m=width_m,
            length_m=2.0,
            polygon=shapely.box(x - east_m, y - north_m, x + east_m, y + north_m),
        )
        for each in world.defects
        for x, y in each.centre.coords
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
    assert coverage(cracked(0.08, along=True), *SURE, "camera.exposure_s=0.02") == 1, "blur lies along these"


@pytest.mark.parametrize("wind", [(), ("conditions.wind_mps=6", "conditions.gust_factor=1.6")])
def test_frames_judged_after_a_mission_have_the_blur_of_the_flight(wind: tuple[str, ...]) -> None:
    """Sideways and in gusts."""
    scene = truck_beside_defects()
    settings = scene.settings("visibility.interval_s=0.1", "camera.capture_interval_s=0.2", *wind)
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0], every_capture=True)
    seen, answers = [], [Displace(1.0, -2.0)]
    for event in mission:
        if isinstance(event, Captured):
            seen.append(mission.frame(event))
        elif isinstance(event, Occluded) and answers:
            mission.act(answers.pop())
    result = result_of(mission)
    for frame in seen:
        assert captured_frame(result, frame.number).blur_m == pytest.approx(frame.blur_m, abs=1e-4)
    sideways = [frame for frame in seen if abs(frame.blur_m[1]) > 0.002]
    assert len(sideways) >= 4
    assert all(frame.yaw_rad == 0 for frame in sideways)
