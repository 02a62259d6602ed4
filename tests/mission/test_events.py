"""Events of a mission are reported as they happen; a mission flown in parts equals one flown at once."""

import numpy as np
import pytest

from pavetwin.mission.events import (
    ActionTaken,
    BatteryRanLow,
    BatterySwapped,
    DefectsConfirmed,
    MissionEvent,
    NoteVisited,
    OcclusionStarted,
    ProgressMade,
    SegmentFinished,
    SegmentStarted,
)
from pavetwin.mission.fly import fly_over
from pavetwin.policies import Displace, Revisit, Wait
from scenes.pilot import Pilot
from scenes.tiny import SCENES, Scene, result, straight


@pytest.mark.parametrize("pause_s", [0.05, 1.7, 40.0])
@pytest.mark.parametrize(("scene", "policy"), [("lively_street", "hover"), ("queue_at_light", "skip")])
def test_a_mission_in_parts_is_the_mission_in_one(scene: str, policy: str, pause_s: float) -> None:
    whole, pilot = result(scene, policy), Pilot(SCENES[scene](), policy)
    pauses = 0
    while not pilot.mission.is_over:
        until_s = pilot.mission.flight.time_s + pause_s
        mission = pilot.advance(until_s)
        assert mission.is_over or until_s - 1e-9 <= mission.flight.time_s < until_s + 0.05
        pauses += 1
    assert pauses > 1
    mission = pilot.advance()
    for ours, theirs in ((mission.flight.track(), whole.track), (mission.flight.captures(), whole.captures)):
        for name in ours:
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)  # type: ignore[literal-required]
    assert (tuple(mission.rows), mission.memory, mission.swaps) == (whole.rows, whole.memory, whole.swaps)
    assert mission.flight.energy_used == whole.energy
    assert tuple(mission.events) == tuple(pilot.events) == whole.events


def test_nothing_is_flown_beyond_the_moment() -> None:
    pilot = Pilot(SCENES["lively_street"](), "hover")
    mission = pilot.advance(7.0)
    assert mission.flight.time_s == pytest.approx(7.0)
    assert not mission.is_over
    assert all(event.time_s <= 7.0 for event in pilot.events)
    assert pilot.advance(3.0).flight.time_s == pytest.approx(7.0)


def test_a_call_flies_without_a_loop_and_returns_what_happened() -> None:
    pilot = Pilot(SCENES["lively_street"](), "hover")
    first = pilot.mission.advance_until(7.0, pilot.answer)
    assert pilot.mission.flight.time_s == pytest.approx(7.0)
    assert first == pilot.events
    assert first
    second = pilot.mission.advance_until(float("inf"), pilot.answer)
    assert [*first, *second] == pilot.events
    assert tuple(pilot.events) == result("lively_street", "hover").events
    assert pilot.mission.advance_until(float("inf")) == []


def test_a_loop_that_was_left_goes_on() -> None:
    pilot = Pilot(SCENES["lively_street"](), "hover")
    for event in pilot.mission:
        pilot.answer(event)
        if pilot.mission.flight.time_s > 7.0:
            break
    assert not pilot.mission.is_over
    for event in pilot.mission:
        pilot.answer(event)
    assert pilot.mission.is_over
    assert tuple(pilot.events) == result("lively_street", "hover").events


def test_events_without_an_answer_confirm_nothing() -> None:
    mission = Pilot(SCENES["lively_street"](), "hover").mission
    happened = mission.advance_until(float("inf"))
    assert mission.is_over
    assert any(isinstance(event, OcclusionStarted) for event in happened)
    assert not any(isinstance(event, ActionTaken | DefectsConfirmed) for event in happened)


def test_events_are_in_order_and_agree_with_the_tables() -> None:
    for scene, policy in (("lively_street", "hover"), ("queue_at_light", "skip"), ("truck_beside_defects", "micro")):
        ours = result(scene, policy)
        times = [event.time_s for event in ours.events]
        assert times == sorted(times)
        started = [event for event in ours.events if isinstance(event, OcclusionStarted)]
        assert len(started) == sum(row.occlusions for row in ours.rows) > 0
        assert all(event.visibility < ours.settings.visibility.threshold for event in started)
        confirmed = [defect for event in ours.events if isinstance(event, DefectsConfirmed) for defect in event.defects]
        assert sorted(confirmed) == sorted(ours.memory.confirmed)
        acted = [event for event in ours.events if isinstance(event, ActionTaken)]
        assert [(event.time_s, event.position) for event in acted] == [(a.time_s, a.position) for a in ours.actions]
        assert {type(event.action) for event in acted} == {{"hover": Wait, "skip": Revisit, "micro": Displace}[policy]}
        visits = [event.note.place for event in ours.events if isinstance(event, NoteVisited)]
        noted = [event.action.place for event in acted if isinstance(event.action, Revisit)]
        assert sorted(visits) == sorted(noted)
        assert len(visits) == sum(row.revisits for row in ours.rows)
        ends = [(event.time_s, event.segment) for event in ours.events if isinstance(event, SegmentFinished)]
        assert ends == [(row.end_s, 0) for row in ours.rows]
        assert [event.segment for event in ours.events if isinstance(event, SegmentStarted)] == [0]
        shares = [event.share for event in ours.events if isinstance(event, ProgressMade)]
        assert shares == sorted(shares)
        assert shares[-1] == 1.0


def test_battery_swaps_are_events() -> None:
    scene = Scene(straight(length_m=300.0), altitude_m=10.0)
    ours = scene.fly("baseline", "energy.capacity_wh=4.2")
    low = [event for event in ours.events if isinstance(event, BatteryRanLow)]
    swapped = [event for event in ours.events if isinstance(event, BatterySwapped)]
    assert len(low) == len(swapped) == ours.swaps > 0
    for before, after in zip(low, swapped, strict=True):
        assert after.time_s - before.time_s > ours.settings.energy.swap_s


def test_fly_reports_events_and_progress() -> None:
    scene = SCENES["lively_street"]()
    settings = scene.settings()
    reported: list[MissionEvent] = []
    shares: list[float] = []
    environment, traffic = scene.environment(settings), scene.traffic()
    ours = fly_over(environment, traffic, settings, [0], "hover", on_progress=shares.append, observer=reported.append)
    assert tuple(reported) == ours.events
    assert shares == [event.share for event in reported if isinstance(event, ProgressMade)]


def test_an_observers_error_ends_the_mission() -> None:
    scene = SCENES["lively_street"]()
    settings = scene.settings()

    def stop(event: MissionEvent) -> None:
        if isinstance(event, OcclusionStarted):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly_over(scene.environment(settings), scene.traffic(), settings, [0], "hover", observer=stop)
