"""What the browser plays of a mission is what the timeline and the results say."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from pavetwin.app.playback import FLIGHT, minute_file, mission_values, tables, write_playback
from pavetwin.mission.metrics import totals
from pavetwin.mission.summary import remarks, sentence
from pavetwin.mission.timeline import Timeline
from scenes import tiny

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
def test_defects_are_found_and_missed_when_the_timeline_says(scene: str, policy: str) -> None:
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


def test_reactions_and_occlusions_are_told_with_their_places() -> None:
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
    told = f"hover found {hover[0]} in {hover[1]:.1f} min, skip {skip[0]} in {skip[1]:.1f} min. "
    assert sentence(results).startswith(f"Of {totals(results[0]).defects} defects {told}")


def test_a_lone_mission_has_a_row_a_segment_and_several_a_row_a_policy() -> None:
    result = tiny.result("lively_street", "hover")
    (alone,) = tables([result])
    assert alone["of"] == "segments"
    assert alone["columns"][0]["cells"] == (result.rows[0].segment,)
    both = tables([result, tiny.result("lively_street", "skip")])
    assert [table["of"] for table in both] == ["policies", "streets"]
    assert both[0]["columns"][0]["cells"] == ("hover", "skip")
