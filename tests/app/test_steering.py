"""Flights and drives by hand over the page's WebSocket."""

import asyncio
import csv
import gzip
import json
import os
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.app import task_pool
from pavetwin.app.live import joined
from pavetwin.app.steering import DRIVER, PEDALS, SEGMENTS, STICKS
from pavetwin.app.task_pool import Messages, TaskProcess
from pavetwin.capture.platforms.car import REAR
from pavetwin.driving.car import Pedals
from pavetwin.driving.drive import Drive, drive_again
from pavetwin.mission.by_hand import PILOT, ByHand, Stick, changes_of_values, fly_again
from pavetwin.mission.inputs import load_inputs
from pavetwin.mission.planning import plan_mission
from pavetwin.sensing import load_sensor
from pavetwin.world.store import load_world
from scenes.page import RunningPage
from scenes.processes import children, command_line, is_gone, is_over
from scenes.steering import Answer, live_folders, say, steer

REQUEST = {"traffic": "low", "seed": 1, "count": 1}
IN_THE_AIR = 3
"""The number of the mode `inspect`."""


def task_processes() -> set[int]:
    return {child for child in children(os.getpid()) if b"app.task_process" in command_line(child)}


def ahead_until(seconds: float) -> Answer:
    """Ahead for so long once it has taken off, then home."""

    def answer(state: dict[str, Any]) -> dict[str, Any] | None:
        if state["t_s"] > seconds:
            return say(lands=True)
        return say(ahead=1.0, turn=0.1) if state["mode"] == IN_THE_AIR else None

    return answer


@pytest.mark.slow
def test_a_flight_grows_lands_is_played_and_can_be_flown_again(page: RunningPage, world: Path) -> None:
    states, end = steer(page, ahead_until(9.0), REQUEST)
    done = end["done"]
    times = [state["t_s"] for state in states]
    assert np.median(np.diff(times)) == pytest.approx(0.1, abs=0.051), "a step each tenth of a second"
    flying = [state for state in states if state["mode"] == IN_THE_AIR]
    assert max(state["speed_mps"] for state in flying) > 3.0
    assert flying[-1]["battery"] < flying[0]["battery"]
    seen = [max(state["coverage"].values(), default=0.0) for state in flying]
    assert seen[-1] > seen[0]
    assert seen == sorted(seen)
    assert states[-1]["altitude_m"] == 0.0
    assert all(state["segment"] in state["coverage"] for state in flying[1:])
    assert live_folders(page) == []
    assert not (world / "missions").exists(), "it is not a mission of the world"

    answer = page.get(f"/api/played/{done['key']}/flight.json.gz")
    (mission,) = json.loads(gzip.decompress(answer.body))["missions"]
    assert mission["policy"] == PILOT
    assert mission["captures"]["t_s"] == [t for state in states for t in state["captures"]["t_s"]]
    assert mission["targets"] == list(states[-1]["coverage"])

    spec = plan_mission(load_world(world), density="low", seed=1, segments=1)
    inputs = load_inputs(spec)
    sensor = load_sensor(spec.settings.sensing, spec.seed)
    again = ByHand(inputs.environment, inputs.traffic, spec.settings, [], policy=PILOT, sensor=sensor.name)
    written = page.get(f"/api/played/{done['key']}/files/{STICKS}").values
    fly_again(again, changes_of_values(written["sticks"], Stick), sensor)
    track = again.result(spec.seed).track
    for name in ("t_s", "x_m", "y_m", "speed_mps"):
        assert np.allclose(track[name], mission["track"][name], atol=0.6e-3)  # type: ignore[literal-required]


@pytest.mark.slow
@pytest.mark.parametrize("how", ["cancel", "leave"])
def test_a_cancelled_flight_leaves_no_process_and_no_file(page: RunningPage, how: str) -> None:
    during: set[int] = set()

    def answer(state: dict[str, Any]) -> dict[str, Any] | None:
        if state["t_s"] < 1.0:
            return None
        during.update(task_processes())
        assert live_folders(page)
        return {"do": how}

    _, end = steer(page, answer, REQUEST)
    assert end == ({"id": 1, "cancelled": True} if how == "cancel" else {})
    assert is_over(lambda: any(map(is_gone, during))), "that of the flight; others wait for tasks"
    assert is_over(lambda: live_folders(page) == [])


@pytest.mark.slow
def test_a_stick_that_is_not_held_returns_to_the_middle(page: RunningPage) -> None:
    speeds: list[float] = []

    def answer(state: dict[str, Any]) -> dict[str, Any] | None:
        if state["mode"] != IN_THE_AIR:
            return None
        speeds.append(state["speed_mps"])
        if len(speeds) == 1:
            return say(ahead=1.0)
        return {"do": "cancel"} if len(speeds) == 30 else None

    steer(page, answer, REQUEST)
    assert max(speeds) > 2.0
    assert speeds[-1] == 0.0


@pytest.mark.parametrize("do", ["pilot", "drive"])
def test_a_sensor_that_looks_after_landing_is_refused(page: RunningPage, do: str) -> None:
    _, end = steer(page, lambda _: None, {**REQUEST, "sensor": "detector"}, do=do)
    assert "answers at once" in end["error"]


@pytest.mark.parametrize(
    "stick",
    [None, [], {"ahead": 2.0}, {"ahead": "fast"}, {"turn": "NaN"}, {"up": 1.0}, {"lands": "/etc"}, {"ahead": 1e308}],
)
def test_an_invalid_stick_ends_its_page_alone(page: RunningPage, stick: Any) -> None:
    async def send() -> str | bytes | None:
        client = await page.connect()
        await client.write_message(json.dumps({"id": 1, "do": "steer", "stick": stick}))
        return await asyncio.wait_for(client.read_message(), 20)

    assert asyncio.run(send()) is None
    assert page.ask({"do": "missions"})[0]["done"]


def test_states_that_a_page_reads_late_are_joined() -> None:
    first = {"t_s": 1.0, "captures": {"t_s": [0.9], "x_m": [3.0]}, "found": [{"id": 1}], "is_low": True, "minutes": 3}
    later = {"t_s": 1.1, "captures": {"t_s": [1.1], "x_m": [4.0]}, "found": [], "is_low": False}
    state = joined(joined({}, first), later)
    assert state["captures"] == {"t_s": [0.9, 1.1], "x_m": [3.0, 4.0]}
    assert (state["t_s"], state["found"], state["is_low"], state["minutes"]) == (1.1, [{"id": 1}], True, 3)


def test_a_stick_without_a_flight_is_ignored(page: RunningPage) -> None:
    async def send() -> Any:
        client = await page.connect()
        await client.write_message(json.dumps({"id": 7, **say(ahead=1.0)}))
        await client.write_message(json.dumps({"id": 8, "do": "missions", "world": "w0"}))
        return json.loads(await client.read_message() or "{}")

    assert asyncio.run(send())["id"] == 8


class Pipe:
    """Replacement for a process: records its input, and ends on request."""

    def __init__(self) -> None:
        self.lines: list[dict[str, Any]] = []
        self.stdin = self.stdout = self
        self.is_over = asyncio.Event()

    def write(self, line: bytes) -> None:
        self.lines.append(json.loads(line))

    async def drain(self) -> None:
        pass

    async def readline(self) -> bytes:
        await self.is_over.wait()
        return b'{"result": {}}\n'


def test_few_of_many_sticks_are_passed_on_and_the_latest_last(monkeypatch: pytest.MonkeyPatch) -> None:
    passed_on = asyncio.Event()

    async def flood() -> list[dict[str, Any]]:
        pipe, messages = Pipe(), Messages()
        process = TaskProcess(pipe)  # type: ignore[arg-type]
        running = asyncio.create_task(process.run({"do": "pilot"}, lambda _: None, messages))
        for burst in range(3):
            for number in range(100):
                messages.send({"ahead": 100 * burst + number})
                await asyncio.sleep(0)
            passed_on.set()  # the least time between two has passed
            await asyncio.sleep(0.01)
        pipe.is_over.set()
        await running
        return pipe.lines

    sleep = asyncio.sleep

    async def wait(seconds: float) -> None:
        if seconds == task_pool.MESSAGE_EVERY_S:
            passed_on.clear()
            await passed_on.wait()
        else:
            await sleep(seconds)

    monkeypatch.setattr(asyncio, "sleep", wait)
    task, *sticks = asyncio.run(flood())
    assert task == {"do": "pilot"}
    assert sticks[0]["message"]["ahead"] < 100, "at once"
    assert sticks[-1] == {"message": {"ahead": 299}}
    assert len(sticks) <= 5, "one for each time that has passed"


STREET = "s0011"
DRIVE = {"traffic": "low", "seed": 1, "segments": [STREET]}


@pytest.mark.slow
def test_a_drive_grows_ends_is_played_and_can_be_driven_again(page: RunningPage, world: Path) -> None:
    states, end = steer(
        page, lambda state: say(lands=True) if state["t_s"] > 8.0 else say(ahead=1.0, turn=0.02), DRIVE, do="drive"
    )
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
    assert not (world / "missions").exists(), "it is not a mission of the world"

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
    drive_again(again, changes_of_values(written["pedals"], Pedals))
    track = mission["track"]
    places = [(each.x_m, each.y_m) for each in again.states]
    assert np.allclose(places, np.column_stack([track["x_m"], track["y_m"]]), atol=0.6e-3)
    assert set(again.confirmed) == found
    exported = page.ask({"do": "export", "key": done["key"], "mission": 0, "what": "html"})[-1]["done"]
    assert exported["files"] == ["results.html"]
    refused = page.ask({"do": "export", "key": done["key"], "mission": 0, "what": "qgc"})[-1]
    assert "mission.yaml" in refused["error"], "a drive is not a mission to plan from"


@pytest.mark.slow
def test_a_drive_that_is_left_leaves_no_file(page: RunningPage) -> None:
    steer(page, lambda state: {"do": "leave"} if state["t_s"] > 0.5 else None, DRIVE, do="drive")
    assert is_over(lambda: live_folders(page) == [])
