"""The whole twin at any moment of a mission, flown or in flight."""

from dataclasses import replace

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.mission.events import ActionTaken, DefectsConfirmed, MissionEvent, NoteVisited, SegmentFinished
from pavetwin.mission.metrics import totals
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline
from pavetwin.sensing import Outcome
from pavetwin.twin import Mode
from scenes.pilot import Pilot
from scenes.tiny import SCENES, Scene, parked, result, straight, street, world

FLOWN = (("lively_street", "hover"), ("queue_at_light", "skip"), ("truck_beside_defects", "micro"))


def timeline_of(scene: str, policy: str) -> tuple[MissionResult, Timeline]:
    ours = result(scene, policy)
    return ours, Timeline(ours)


@pytest.mark.parametrize(("scene", "policy"), FLOWN)
def test_at_a_sample_of_the_track_the_state_is_that_sample(scene: str, policy: str) -> None:
    ours, timeline = timeline_of(scene, policy)
    track = ours.track
    for row in range(0, len(track["t_s"]), 17):
        state = timeline.at(float(track["t_s"][row]))
        assert state.uav.position == (track["x_m"][row], track["y_m"][row])
        assert (state.uav.altitude_m, state.uav.battery) == (track["altitude_m"][row], track["battery"][row])
        assert np.exp(1j * state.uav.yaw_rad) == pytest.approx(np.exp(1j * track["yaw_rad"][row]))
        visibility = float(track["visibility"][row])
        assert state.visibility == (None if np.isnan(visibility) else visibility)
        assert (state.segment is None) == (track["segment"][row] < 0)


def test_between_samples_it_is_interpolated() -> None:
    ours, timeline = timeline_of("lively_street", "hover")
    before, after = (timeline.at(float(time_s)).uav for time_s in ours.track["t_s"][40:42])
    between = timeline.at(float(ours.track["t_s"][40:42].mean())).uav
    for name in ("altitude_m", "battery", "speed_mps"):
        assert getattr(between, name) == pytest.approx((getattr(before, name) + getattr(after, name)) / 2)
    assert between.position == pytest.approx(np.mean([before.position, after.position], axis=0))


@pytest.mark.parametrize(("scene", "policy"), FLOWN)
def test_what_is_found_and_missed_changes_when_it_happens(scene: str, policy: str) -> None:
    ours, timeline = timeline_of(scene, policy)
    for event in timeline.events():
        before, after = timeline.at(np.nextafter(event.time_s, 0)), timeline.at(event.time_s)
        match event:
            case DefectsConfirmed(defects=defects):
                assert not set(defects) & set(before.found)
                assert set(defects) <= set(after.found)
                news = after.detections[len(before.detections) :]
                assert after.detections[: len(before.detections)] == before.detections
                assert set(defects) == set(news.defect[news.outcome == Outcome.CONFIRMED].tolist())
                assert all(after.found[defect] == ours.memory.confirmed[defect] for defect in defects)
            case SegmentFinished(segment=segment):
                assert segment not in before.finished
                assert not before.missed
                unfound = {defect.id for defect in ours.environment.defects} - set(ours.memory.confirmed)
                assert after.missed == unfound
            case ActionTaken():
                assert after.actions[: len(before.actions)] == before.actions
                assert event in after.actions
                assert event not in before.actions
            case NoteVisited(note=note):
                assert note in before.notes
                assert note not in after.notes
    end = timeline.at(ours.duration_s)
    assert dict(end.found) == dict(ours.memory.confirmed)
    assert end.detections == ours.detections
    assert (end.captures, end.notes) == (len(ours.captures["t_s"]), ())


def test_a_missed_defect_is_missed_once_its_segment_is_left() -> None:
    ours = result("parked_car_over_defect", "baseline")
    timeline = Timeline(ours)
    (row,) = ours.rows
    assert timeline.at(row.end_s - 0.01).missed == frozenset()
    assert timeline.at(row.end_s).missed == {0}
    assert timeline.at(row.end_s).finished == (0,)


@pytest.mark.parametrize(("scene", "policy"), FLOWN)
def test_the_counters_end_at_the_missions_totals(scene: str, policy: str) -> None:
    ours, timeline = timeline_of(scene, policy)
    end, sums = timeline.at(ours.duration_s), totals(ours)
    assert (end.occlusions, end.swaps) == (sums.occlusions, sums.swaps)
    assert end.energy == pytest.approx(sums.energy, abs=3e-4)
    assert end.wait_s == pytest.approx(sums.wait_s, abs=1.0)
    halfway = timeline.at(ours.duration_s / 2)
    assert 0 < halfway.energy < end.energy
    assert halfway.wait_s <= end.wait_s


def test_energy_counts_on_over_a_swap() -> None:
    scene = Scene(straight(length_m=300.0), altitude_m=10.0)
    ours = scene.fly("baseline", "energy.capacity_wh=4.2")
    timeline = Timeline(ours)
    end = timeline.at(ours.duration_s)
    assert end.swaps == ours.swaps > 0
    assert end.energy == pytest.approx(ours.energy, abs=0.01)
    assert {timeline.at(float(time_s)).uav.mode for time_s in ours.track["t_s"]} >= {Mode.SWAP, Mode.INSPECT}


def test_while_it_looks_whether_to_wait_on_it_waits() -> None:
    _, timeline = timeline_of("car_that_leaves", "hover")
    (first, *_) = (event for event in timeline.events() if isinstance(event, ActionTaken))
    times = np.arange(first.time_s + 2.0, first.time_s + 12.0, 0.1)
    assert {timeline.at(float(time_s)).uav.mode for time_s in times} == {Mode.WAIT}


def test_agents_are_those_of_the_traffic() -> None:
    scene = Scene(straight((30, 0)), (parked(30, 0, until_s=5.0),))
    ours = scene.fly("baseline")
    timeline = Timeline(ours)
    (agent,) = timeline.at(3.0).agents
    assert agent.position == (30.0, 0.0)
    assert len(timeline.at(3.0).agents_near((30.0, 0.0), 5.0)["agent"]) == 1
    assert len(timeline.at(3.0).agents_near((50.0, 0.0), 5.0)["agent"]) == 0
    assert timeline.at(8.0).agents == ()


def test_events_of_a_stretch_of_time() -> None:
    ours, timeline = timeline_of("lively_street", "hover")
    assert timeline.events() == ours.events
    (start, *_, end) = (event.time_s for event in ours.events)
    assert timeline.events(start, end) == ours.events
    assert timeline.events(end + 0.01) == ()
    middle = (start + end) / 2
    assert timeline.events(end_s=middle) + timeline.events(middle + 1e-6) == ours.events


@pytest.mark.parametrize(("scene", "policy"), FLOWN)
def test_a_timeline_in_flight_equals_that_of_the_result(scene: str, policy: str) -> None:
    _, whole = timeline_of(scene, policy)
    pilot = Pilot(SCENES[scene](), policy)
    for until_s in (0.0, 3.3, 11.15, 31.7):
        mission = pilot.advance(until_s)
        timeline = Timeline(mission)
        assert timeline.duration_s == pytest.approx(until_s)
        now, then = timeline.at(timeline.duration_s), whole.at(timeline.duration_s)
        # Within one look of now the flown track knows the next sample; here the state itself is the last.
        assert now.uav.position == pytest.approx(then.uav.position, abs=0.1)
        state = mission.state()
        assert now.uav == replace(state, mode=now.uav.mode, yaw_rad=now.uav.yaw_rad)
        assert np.exp(1j * now.uav.yaw_rad) == pytest.approx(np.exp(1j * state.yaw_rad))
        for name in (
            "found",
            "missed",
            "detections",
            "finished",
            "actions",
            "notes",
            "captures",
            "occlusions",
            "swaps",
            "segment",
        ):
            assert getattr(now, name) == getattr(then, name), name
        reported: tuple[MissionEvent, ...] = timeline.events()
        assert reported == whole.events(end_s=timeline.duration_s)
        earlier = timeline.duration_s / 2
        assert timeline.at(earlier).uav.position == whole.at(earlier).uav.position


def test_there_is_no_state_outside_the_mission() -> None:
    ours, timeline = timeline_of("lively_street", "hover")
    for time_s in (-0.1, ours.duration_s + 0.1):
        with pytest.raises(PaveTwinError, match="no moment at"):
            timeline.at(time_s)


def test_two_segments_are_finished_in_order() -> None:
    two = Scene(world([street("west", (0, 0), (40, 0), width_m=7), street("east", (40, 0), (80, 0), width_m=7)]))
    ours = two.fly("baseline")
    timeline = Timeline(ours)
    assert [timeline.at(row.end_s).finished for row in ours.rows] == [(0,), (0, 1)]
