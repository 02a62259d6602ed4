"""Drives by hand over the page's WebSocket: they follow the stick, grow, end, are played, and can be driven again."""

import csv
import gzip
import json
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.app.steering import DRIVER, PEDALS, SEGMENTS
from pavetwin.capture.platforms.car import REAR
from pavetwin.driving.drive import Drive, drive_again, pedals_of_values
from pavetwin.mission.inputs import load_inputs
from pavetwin.mission.planning import plan_mission
from pavetwin.sensing import load_sensor
from pavetwin.world.store import load_world
from scenes.page import RunningPage
from scenes.processes import is_over
from scenes.steering import Answer, live_folders, say, steer

STREET = "s0011"
REQUEST = {"traffic": "low", "seed": 1, "segments": [STREET]}


def ahead_until(seconds: float) -> Answer:
    def answer(state: dict[str, Any]) -> dict[str, Any] | None:
        return say(lands=True) if state["t_s"] > seconds else say(ahead=1.0, turn=0.02)

    return answer


@pytest.mark.slow
def test_a_drive_grows_ends_is_played_and_can_be_driven_again(page: RunningPage, world: Path) -> None:
    states, end = steer(page, ahead_until(8.0), REQUEST, do="drive")
    done = end["done"]
    steps = np.diff([state["t_s"] for state in states]) / 0.1
    assert np.allclose(steps, np.round(steps), atol=1e-6)
    assert np.median(steps) == pytest.approx(1.0), "a step each tenth of a second, fewer where the page reads late"
    assert max(state["speed_mps"] for state in states) > 6.0
    assert states[-1]["speed_mps"] == 0.0
    seen = [state["coverage"].get(STREET, 0.0) for state in states]
    assert seen == sorted(seen)
    assert seen[-1] > 0.1
    assert {state["altitude_m"] for state in states} == {REAR.z_m}
    assert live_folders(page) == []
    assert not (world / "missions").exists(), "it is no mission of the world"

    answer = page.get(f"/api/played/{done['key']}/flight.json.gz")
    played = json.loads(gzip.decompress(answer.body))
    (mission,) = played["missions"]
    assert mission["policy"] == DRIVER
    assert mission["captures"]["t_s"] == pytest.approx([t for state in states for t in state["captures"]["t_s"]])
    assert mission["targets"] == list(states[-1]["coverage"])
    found = {each["id"] for state in states for each in state["found"]}
    assert found == {each["id"] for each in mission["defects"] if each["found_s"] is not None}
    assert all(each["found_s"] is not None or each["reason"] for each in mission["defects"])
    assert "its guest" in played["remarks"][0]
    text = page.get(f"/api/played/{done['key']}/files/{SEGMENTS}").body.decode()
    (row,) = [each for each in csv.DictReader(StringIO(text)) if each["segment"] == STREET]
    assert float(row["surface_coverage"]) == pytest.approx(seen[-1], abs=1e-3)

    spec = plan_mission(load_world(world), density="low", seed=1, segments=[STREET])
    inputs = load_inputs(spec)
    sensor = load_sensor(spec.settings.sensing, spec.seed)
    again = Drive(inputs.environment, inputs.traffic, spec.settings, sensor, street=STREET)
    written = page.get(f"/api/played/{done['key']}/files/{PEDALS}").values
    drive_again(again, pedals_of_values(written["pedals"]))
    track = mission["track"]
    places = [(each.x_m, each.y_m) for each in again.states]
    assert np.allclose(places, np.column_stack([track["x_m"], track["y_m"]]), atol=0.6e-3)
    assert set(again.confirmed) == found
    exported = page.ask({"do": "export", "key": done["key"], "mission": 0, "what": "html"})[-1]["done"]
    assert exported["files"] == ["results.html"]
    refused = page.ask({"do": "export", "key": done["key"], "mission": 0, "what": "qgc"})[-1]
    assert "mission.yaml" in refused["error"], "a drive is no mission to plan from"


@pytest.mark.slow
def test_who_leaves_a_drive_leaves_no_file(page: RunningPage) -> None:
    steer(page, lambda state: {"do": "leave"} if state["t_s"] > 0.5 else None, REQUEST, do="drive")
    assert is_over(lambda: live_folders(page) == [])


def test_a_sensor_that_looks_afterwards_is_refused(page: RunningPage) -> None:
    _, end = steer(page, lambda _: None, {**REQUEST, "sensor": "detector"}, do="drive")
    assert "answers at once" in end["error"]
