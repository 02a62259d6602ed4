"""Played data of missions agrees with the timeline and the results, agents included."""

import gzip
import json
import struct
from math import floor, inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin._core import Trace
from pavetwin.app.playback import FLIGHT, MAGIC, MINUTE_S, minute_file, minutes, mission_values, tables, write_playback
from pavetwin.mission.metrics import totals
from pavetwin.mission.summary import remarks, sentence
from pavetwin.mission.timeline import Timeline
from scenes import tiny
from scenes.tiny import CAR, PERSON, STEP_S, Mover, parked, passing, trace_of

FLOWN = (("lively_street", "hover"), ("queue_at_light", "skip"), ("truck_beside_defects", "micro"))


@pytest.mark.parametrize(("scene", "policy"), FLOWN)
def test_the_interpolated_track_is_the_timelines(scene: str, policy: str) -> None:
    result = tiny.result(scene, policy)
    values, timeline = mission_values(result), Timeline(result)
    track = values["track"]
    for time_s in np.linspace(0.0, result.duration_s, 23):
        uav = timeline.at(float(time_s)).uav
        x, y = (np.interp(time_s, track["t_s"], track[name]) for name in ("x_m", "y_m"))
        assert np.hypot(x - uav.position[0], y - uav.position[1]) < 0.005
        assert np.interp(time_s, track["t_s"], track["yaw_rad"]) == pytest.approx(uav.yaw_rad, abs=1e-3)
        assert np.interp(time_s, track["t_s"], track["battery"]) == pytest.approx(uav.battery, abs=1e-4)
        assert values["modes"][track["mode"][timeline.row(float(time_s))]]["name"] == uav.mode.value


@pytest.mark.parametrize(("scene", "policy"), FLOWN)
def test_defects_are_found_and_missed_at_the_times_of_the_timeline(scene: str, policy: str) -> None:
    result = tiny.result(scene, policy)
    values, timeline = mission_values(result), Timeline(result)
    finished = {event["segment"]: event["t_s"] for event in values["events"] if event["kind"] == "finish"}
    for time_s in np.linspace(0.0, result.duration_s, 23):
        state = timeline.at(float(time_s))
        found = {each["id"] for each in values["defects"] if each["found_s"] is not None and each["found_s"] <= time_s}
        missed = {
            each["id"]
            for each in values["defects"]
            if each["found_s"] is None and finished.get(each["segment"], np.inf) <= time_s
        }
        assert found == set(state.found)
        assert missed == set(state.missed)
    for each in values["defects"]:
        assert (each["reason"] is None) == (each["found_s"] is not None)


def test_reactions_and_occlusions_have_their_places() -> None:
    values = mission_values(tiny.result("queue_at_light", "skip"))
    kinds = [event["kind"] for event in values["events"]]
    assert {"start", "occlusion", "revisit", "return", "finish"} <= set(kinds)
    assert [event["t_s"] for event in values["events"]] == sorted(event["t_s"] for event in values["events"])
    assert all(len(event["place_m"]) == 2 for event in values["events"] if event["kind"] in ("revisit", "return"))


def test_the_files_hold_all_missions_and_as_many_minutes_as_the_longest_lasts(tmp_path: Path) -> None:
    results = [tiny.result("queue_at_light", policy) for policy in ("hover", "skip")]
    write_playback(results, tmp_path, step_s=tiny.STEP_S)
    flight = json.loads(gzip.decompress((tmp_path / FLIGHT).read_bytes()))
    assert [mission["policy"] for mission in flight["missions"]] == ["hover", "skip"]
    assert flight["sentence"] == sentence(results)
    assert flight["remarks"] == remarks(results)
    longest_s = max(result.duration_s for result in results)
    assert (flight["minutes"] - 1) * 60 < longest_s <= flight["minutes"] * 60
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {FLIGHT, *(minute_file(number) for number in range(flight["minutes"]))}
    agents = flight["agents"]
    trace = results[0].trace.agents_at(0.0)
    for row, agent in enumerate(trace["agent"].tolist()):
        assert agents["length_m"][agent] == pytest.approx(trace["length_m"][row], abs=0.01)
        assert agents["groups"][agents["group"][agent]] != "pedestrian"


def test_several_missions_begin_with_what_each_found() -> None:
    results = [tiny.result("queue_at_light", policy) for policy in ("hover", "skip")]
    hover, skip = ((totals(each).confirmed, totals(each).time_s / 60) for each in results)
    reported = f"hover found {hover[0]} in {hover[1]:.1f} min, skip {skip[0]} in {skip[1]:.1f} min. "
    assert sentence(results).startswith(f"Of {totals(results[0]).defects} defects {reported}")


def test_a_lone_mission_has_a_row_a_segment_and_several_a_row_a_policy() -> None:
    result = tiny.result("lively_street", "hover")
    (alone,) = tables([result])
    assert alone["of"] == "segments"
    assert alone["columns"][0]["cells"] == (result.rows[0].segment,)
    both = tables([result, tiny.result("lively_street", "skip")])
    assert [table["of"] for table in both] == ["policies", "streets"]
    assert both[0]["columns"][0]["cells"] == ("hover", "skip")


LENGTH_S = 130.0


def decoded(content: bytes) -> list[tuple[int, int, np.ndarray]]:
    """Agent, first step and poses (n, 3) of each run."""
    magic, runs, poses = struct.unpack_from("<3I", content)
    assert magic == MAGIC
    layout = [("<u4", runs), ("<i4", runs), ("<i4", runs), ("<u2", runs), ("<u2", runs), ("<i2", runs)]
    columns, at = [], 12
    for kind, count in [*layout, *[("<i2", poses)] * 3]:
        columns.append(np.frombuffer(content, kind, count, at))
        at += columns[-1].nbytes
    assert at == len(content)
    agent, x, y, first, count, yaw, *steps = columns
    found, row = [], 0
    for run in range(runs):
        own = slice(row, row + int(count[run]))
        starts = np.array([x[run], y[run], yaw[run]], dtype=np.int64)
        places = starts + np.cumsum(np.column_stack([step[own] for step in steps]).astype(np.int64), axis=0)
        found.append((int(agent[run]), int(first[run]), places * [0.01, 0.01, 1e-4]))
        row = own.stop
    return found


def poses_at(content: bytes, step: float) -> dict[int, np.ndarray]:
    """x, y, yaw by agent, as the page's `posesAt` gives them."""
    whole, found = floor(step + 1e-9), {}
    for agent, first, poses in decoded(content):
        at = whole - first
        if 0 <= at < len(poses):
            after = poses[min(at + 1, len(poses) - 1)]
            found[agent] = poses[at] + (after - poses[at]) * max(0.0, step - whole)
    return found


def check(trace: Trace, time_s: float) -> None:
    """The browser's agents at a moment are those of the trace, within 2 cm and 0.1°."""
    made = list(minutes(trace, STEP_S, LENGTH_S))
    number = min(floor(time_s / MINUTE_S), len(made) - 1)
    ours, theirs = poses_at(made[number], (time_s - number * MINUTE_S) / STEP_S), trace.agents_at(time_s)
    assert sorted(ours) == sorted(theirs["agent"].tolist())
    for row, agent in enumerate(theirs["agent"].tolist()):
        x, y, yaw = ours[agent]
        assert np.hypot(x - theirs["x_m"][row], y - theirs["y_m"][row]) < 0.02
        assert abs(np.angle(np.exp(1j * (yaw - theirs["yaw_rad"][row])))) < 2e-3


def turning(t: float) -> tuple[float, float, float, float]:
    """A round trip whose heading passes through ±π."""
    angle = 0.2 * t
    return 20 * np.cos(angle), 20 * np.sin(angle), float(np.angle(np.exp(1j * (angle + np.pi / 2)))), 4.0


def leaping(t: float) -> tuple[float, float, float, float]:
    """Is put elsewhere by SUMO at 40 s, and drives on."""
    return (2.0 * t, 5.0, 0.0, 2.0) if t < 40 else (900.0 + 2.0 * t, 5.0, 0.0, 2.0)


def coming_and_going(t: float) -> tuple[float, float, float, float] | None:
    """Leaves the streets for half a minute."""
    return None if 45 <= t < 75 else (3.0 * t, -2.0, 0.0, 3.0)


MOVERS = [
    parked(5.0, 3.0, until_s=80.0),
    passing(0.0, 1.75, 8.0),
    passing(60.0, -1.75, -13.0, from_s=20.0),
    Mover(PERSON, turning),
    Mover(CAR, leaping),
    Mover(CAR, coming_and_going),
]
TRACE = trace_of(MOVERS, LENGTH_S)


@given(st.floats(0.0, LENGTH_S))
def test_the_browser_has_the_agents_of_the_trace_at_any_moment(time_s: float) -> None:
    check(TRACE, time_s)


@pytest.mark.parametrize("time_s", [0.0, 39.75, 40.0, 44.75, 45.0, 59.75, 60.0, 75.0, 80.0, 120.0, LENGTH_S])
def test_agents_that_come_go_leap_and_cross_a_minute(time_s: float) -> None:
    check(TRACE, time_s)


def test_empty_streets_have_minutes_too() -> None:
    made = list(minutes(trace_of([], LENGTH_S), STEP_S, 61.0))
    assert [decoded(content) for content in made] == [[], []]


def test_a_mission_shorter_than_a_minute_has_one() -> None:
    assert len(list(minutes(TRACE, STEP_S, 12.0))) == 1
    assert len(list(minutes(TRACE, STEP_S, MINUTE_S))) == 1


def test_standing_traffic_takes_one_run_an_agent_and_minute() -> None:
    made = list(minutes(trace_of([parked(x, 0.0, until_s=inf) for x in range(5)], LENGTH_S), STEP_S, LENGTH_S))
    assert [len(decoded(content)) for content in made] == [5, 5, 5]
