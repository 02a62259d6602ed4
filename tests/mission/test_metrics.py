"""Metrics of missions, and the interval of the share of defects found."""

from itertools import pairwise
from math import isclose
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely
from scipy.stats import binomtest
from shapely import Polygon

from pavetwin.mission.environment import window_m
from pavetwin.mission.metrics import FoundShare, found_share
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import MODES
from pavetwin.policies import policy_names
from pavetwin.twin import Confirmation, InspectionMemory, Mode, Note, SegmentStatus
from scenes.studies import CASES, streets
from scenes.tiny import Scene, bent, parked, result, straight

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, TrackColumns


POLICIES = policy_names()


def windows(result: MissionResult, columns: "CaptureColumns | TrackColumns", rows: np.ndarray) -> list[Polygon]:
    """The inspection window on the ground at some rows of the track or of the captures."""
    across, along = window_m(result.settings)
    found = []
    for row in rows:
        yaw, at = columns["yaw_rad"][row], np.array([columns["x_m"][row], columns["y_m"][row]])
        ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        corners = [at + a * ahead * along / 2 + b * left * across / 2 for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        found.append(Polygon(corners))
    return found


@pytest.fixture(scope="module")
def tour() -> MissionResult:
    """Three segments around a corner with a van on one of them, in the paper's way."""
    scene = Scene(bent(), (parked(55, 10, yaw_rad=0.59),), altitude_m=10.0)
    return scene.fly("hover", "policy.max_wait_s=10", preset="paper")


@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.parametrize("altitude_m", [6.0, 15.0])
def test_surface_coverage_is_the_area_below_the_captures(preset: str, altitude_m: float) -> None:
    """In an empty street every cell below a window is seen."""
    scene = Scene(straight((30, 0), width_m=9.0), altitude_m=altitude_m)
    ours = scene.fly("baseline", preset=preset)
    seen = shapely.union_all(windows(ours, ours.captures, np.arange(len(ours.captures["t_s"]))))
    street = scene.world.segments[0].polygon
    expected = seen.intersection(street).area / street.area
    assert ours.rows[0].surface_coverage == pytest.approx(expected, abs=0.02)
    if preset == "default":
        assert expected > 0.99
    elif altitude_m == 6.0:
        assert expected < 0.8  # 1.9 m long windows every 3 m leave gaps


def test_coverage_counts_all_defects_and_swath_coverage_those_that_the_window_passed_over() -> None:
    """Two defects lie where the paper's narrow windows never come: at the kerb, and between the passes."""
    scene = Scene(straight((30, 1.75), (20, 2.2), (30, 5.9), (40, -1.5), (44, 0.0), width_m=12.0), altitude_m=6.0)
    ours = scene.fly("baseline", "camera.capture_interval_s=0.1", "visibility.interval_s=0.1", preset="paper")
    row = ours.rows[0]
    inspecting = np.flatnonzero(ours.track["segment"] == 0)
    swath = shapely.union_all(windows(ours, ours.track, inspecting))
    swept = [defect.id for defect in scene.world.defects if swath.contains(defect.centre)]
    assert swept == [0, 1, 3]  # passes at ±3 m, 3.6 m wide: 1.2 to 4.8 m from the middle
    assert (row.defects, row.swept, row.confirmed) == (5, 3, 3)
    assert sorted(ours.memory.confirmed) == swept
    assert row.coverage == pytest.approx(len(swept) / 5)
    assert row.swath_coverage == 1.0
    assert row.recovery == 0.0


def test_a_defect_that_the_swath_passed_between_two_captures_counts_as_swept() -> None:
    """The paper's window at 6 m is 1.9 m long and captures are 3 m apart: some of a row of defects falls between."""
    places = [(10 + 0.5 * k, 1.75) for k in range(60)]
    ours = Scene(straight(*places)).fly("baseline", preset="paper")
    row = ours.rows[0]
    assert row.swept == 60
    assert row.coverage == row.swath_coverage == pytest.approx(1.896 / 3, abs=0.05)


def test_what_is_undefined_is_none() -> None:
    row = Scene(straight()).fly("baseline").rows[0]
    assert (row.defects, row.swept, row.confirmed) == (0, 0, 0)
    assert row.coverage is None
    assert row.swath_coverage is None
    assert row.recovery is None
    assert row.surface_coverage == 1.0


def test_swath_coverage_is_none_where_the_window_passed_over_no_defect() -> None:
    ours = Scene(straight((30, 0.0), width_m=12.0)).fly("baseline", preset="paper")
    row = ours.rows[0]
    assert (row.defects, row.swept) == (1, 0)
    assert row.coverage == 0.0
    assert row.swath_coverage is None
    assert row.recovery is None


def test_recovery_is_a_share_of_what_was_swept() -> None:
    """The narrow windows pass over defect 0, under a car that leaves, and never over defect 1 between them."""
    scene = Scene(straight((30, 1.0), (50, 0.0), width_m=4.0), (parked(30, 1.0, until_s=40.0),))
    row = scene.fly("skip", "camera.window_columns=0.2", "pattern.kind=out_and_back").rows[0]
    assert (row.defects, row.swept, row.confirmed, row.recovered) == (2, 1, 1, 1)
    assert (row.coverage, row.swath_coverage, row.recovery) == (0.5, 1.0, 1.0)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("scene", ["lively_street", "queue_that_leaves", "truck_beside_defects"])
def test_shares_follow_from_the_counts_and_the_memory(scene: str, policy: str) -> None:
    ours = result(scene, policy)
    row, memory = ours.rows[0], ours.memory
    recovered = [defect for defect, confirmation in memory.confirmed.items() if confirmation.on_revisit]
    assert row.confirmed == len(memory.confirmed) == len(ours.detections)
    assert row.recovered == len(recovered)
    assert 0 <= row.recovered <= row.confirmed <= row.swept <= row.defects == len(ours.environment.defects)
    assert row.coverage == row.confirmed / row.defects
    assert row.swath_coverage == row.confirmed / row.swept
    assert row.recovery == row.recovered / row.swept
    assert row.recovered == 0 or policy == "skip"
    assert memory.surface_coverage["street"] == row.surface_coverage
    assert row.inspected == (row.surface_coverage >= 0.95) == (memory.status_of("street") is SegmentStatus.INSPECTED)
    found = ours.detections
    for defect, time_s, on_revisit in zip(found.defect, found.time_s, found.on_revisit, strict=True):
        assert memory.confirmed[defect] == Confirmation(time_s, on_revisit)


def test_times_energies_and_distances_of_segments_add_up(tour: MissionResult) -> None:
    rows = tour.rows
    assert [row.order for row in rows] == [0, 1, 2]
    assert rows[0].start_s == 0.0
    assert all(isclose(after.start_s, before.end_s) for before, after in pairwise(rows))
    assert all(row.time_s == pytest.approx(row.end_s - row.start_s) for row in rows)
    # Up to the last segment's end; the way home comes after it.
    track, end_s = tour.track, rows[-1].end_s
    last = int(np.argmin(np.abs(track["t_s"] - end_s)))
    assert abs(track["t_s"][last] - end_s) < 0.31
    assert sum(row.energy for row in rows) == pytest.approx(1 - track["battery"][last], abs=0.31 / 1800)
    steps = np.hypot(np.diff(track["x_m"][: last + 1]), np.diff(track["y_m"][: last + 1]))
    assert sum(row.distance_m for row in rows) == pytest.approx(steps.sum(), rel=0.01)
    assert tour.duration_s > end_s
    assert tour.energy == pytest.approx(tour.duration_s / 1800)  # the linear model
    assert sum(row.energy for row in rows) == pytest.approx(end_s / 1800)


def test_waits_and_occlusions_are_those_of_the_track(tour: MissionResult) -> None:
    waiting = tour.track["mode"] == MODES.index(Mode.WAIT)
    assert tour.rows[0].wait_s > 5
    assert sum(row.wait_s for row in tour.rows) == pytest.approx(0.3 * waiting.sum(), rel=0.1)
    assert [row.wait_s for row in tour.rows[1:]] == [0.0, 0.0]
    assert [row.occlusions for row in tour.rows[1:]] == [0, 0]
    for row in tour.rows:
        at = (tour.track["segment"] == row.order) & ~np.isnan(tour.track["visibility"])
        below = tour.track["visibility"][at] < 0.7
        falls = int(below[0]) + int((below[1:] & ~below[:-1]).sum())
        assert row.occlusions <= falls if row.occlusions else falls == 0


def test_each_row_describes_its_own_segment(tour: MissionResult) -> None:
    for row, segment in zip(tour.rows, tour.environment.world.segments, strict=True):
        assert row.segment == segment.id
        assert row.length_m == pytest.approx(segment.centre_line.length)
        assert row.area_m2 == pytest.approx(segment.polygon.area)
        assert row.defects == len(list(tour.environment.world.defects_of(segment.id)))
        times = tour.captures["t_s"][tour.captures["segment"] == row.order]
        assert row.start_s < times.min() <= times.max() <= row.end_s


def test_the_uav_takes_off_at_the_base_and_lands_there(tour: MissionResult) -> None:
    track, base = tour.track, tour.environment.world.base
    for row in (0, -1):
        assert np.hypot(track["x_m"][row] - base.x, track["y_m"][row] - base.y) < 0.6
    assert track["altitude_m"][0] == 0.0
    assert track["altitude_m"][-1] < 1.0
    assert track["mode"][-1] == MODES.index(Mode.LAND)
    climbing = track["mode"] == MODES.index(Mode.CLIMB)
    assert np.ptp(track["x_m"][climbing]) == np.ptp(track["y_m"][climbing]) == 0.0
    away = ~np.isin(track["mode"], [MODES.index(m) for m in (Mode.GROUND, Mode.CLIMB, Mode.LAND)])
    assert (track["altitude_m"][away] == 10.0).all()


def test_the_memory_begins_pending_and_ends_inspected() -> None:
    ours = Scene(bent()).fly("baseline")
    assert {ours.memory.status_of(name) for name in ("bent", "side", "ahead")} == {SegmentStatus.INSPECTED}
    narrow = Scene(straight((30, 0), width_m=16.0)).fly("baseline", preset="paper")
    assert narrow.memory.status_of("street") is SegmentStatus.PENDING  # two strips of 3.6 m on 16 m
    assert not narrow.rows[0].inspected
    assert narrow.memory.surface_coverage["street"] < 0.5


# The memory as a value.


def test_a_memory_is_never_changed() -> None:
    empty = InspectionMemory()
    covered = empty.cover("a", 0.5, 0.95).cover("a", 0.97, 0.95).confirm([1], Confirmation(3.0, on_revisit=False))
    noted = covered.note(Note((1.0, 2.0), 4.0, 5.0))
    assert empty == InspectionMemory()
    assert empty.status_of("a") is SegmentStatus.PENDING
    assert covered.status_of("a") is SegmentStatus.INSPECTED
    assert covered.notes == ()
    assert noted.last_note() == Note((1.0, 2.0), 4.0, 5.0)
    assert noted.forget_notes() == covered
    for table in (covered.confirmed, covered.status, covered.surface_coverage):
        with pytest.raises(TypeError):
            table["b"] = 1  # type: ignore[index]


def test_the_first_confirmation_stands() -> None:
    memory = InspectionMemory().confirm([1], Confirmation(3.0, on_revisit=False))
    assert memory.confirm([1], Confirmation(9.0, on_revisit=True)) is memory


def test_a_place_is_noted_near_when_a_note_is_closer_than_the_radius() -> None:
    memory = InspectionMemory().note(Note((0.0, 0.0), 1.0, 5.0))
    assert memory.noted_near((1.4, 0.0), 1.5)
    assert not memory.noted_near((1.5, 0.0), 1.5)
    assert not InspectionMemory().noted_near((0.0, 0.0), 1.5)
    assert InspectionMemory().last_note() is None


def width(found: list[int], defects: list[int]) -> float:
    known = share(found, defects)
    return known.high - known.low


def share(found: list[int], defects: list[int]) -> FoundShare:
    known = found_share(found, defects)
    assert known is not None
    return known


def test_fewer_defects_fewer_streets_and_streets_that_differ_widen_the_interval() -> None:
    assert width([8] * 10, [10] * 10) < width([4] * 10, [5] * 10) < width([4] * 5, [5] * 5) < width([4], [5])
    assert width([8] * 10, [10] * 10) < width([10, 6] * 5, [10] * 10) < width([10] * 8 + [0] * 2, [10] * 10)


def test_streets_without_defects_do_not_count() -> None:
    assert found_share([0, 0], [0, 0]) is None
    assert share([3, 0, 5], [4, 0, 6]) == share([3, 5], [4, 6])
    assert (share([3, 5], [4, 6]).share, share([3, 5], [4, 6]).defects) == (0.8, 10)


def test_what_was_always_or_never_found_is_not_certain() -> None:
    always, never = share([3, 3, 3], [3, 3, 3]), share([0, 0, 0], [3, 3, 3])
    assert always.high == 1.0
    assert 0.4 < always.low < 0.75
    assert (never.low, never.high) == pytest.approx((0.0, 1 - always.low))


def test_an_interval_is_no_shorter_than_of_independent_defects() -> None:
    """One defect a street is nothing but independent draws: Clopper and Pearson's interval, a little wider."""
    found = [1] * 34 + [0] * 6
    ours, exact = share(found, [1] * 40), binomtest(34, 40).proportion_ci()
    assert ours.low == pytest.approx(exact.low, abs=0.01)
    assert ours.low <= exact.low < exact.high <= ours.high


@pytest.mark.slow
@pytest.mark.parametrize("defects", [3, 10, 30])
@pytest.mark.parametrize("count", [1, 4, 10, 20])
def test_intervals_of_one_mission_hold_the_truth(count: int, defects: int) -> None:
    """Nominally 95 of 100, for 3, 10 and 30 defects a street."""
    for truth, alike in CASES:
        rng = np.random.default_rng([count, defects, round(100 * truth), round(100 * alike)])
        drawn = [streets(rng, count, defects, truth, alike) for _ in range(500)]
        known = [found_share(found.tolist(), there.tolist()) for found, there in drawn if there.any()]
        assert np.mean([each.low <= truth <= each.high for each in known]) >= 0.93, (truth, alike)
