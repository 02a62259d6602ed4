"""What the page starts is what the command line does: the same folders, bytes and words; and what it refuses."""

import asyncio
import gzip
import json
import os
import re
import shutil
import signal
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from shapely import Point

from pavetwin.mission.planning import plan_mission
from pavetwin.world.store import load_world
from scenes.command_line import pavetwin
from scenes.folders import digests
from scenes.page import RunningPage, result_of, running_page
from scenes.processes import children, command_line, is_gone, is_over, resident_bytes, simulations

USUAL = {"traffic": "low", "seed": 1}
SHORT = ("--density", "low", "--seed", "1")


@pytest.fixture(scope="module")
def ids(world: Path) -> list[str]:
    return [segment.id for segment in load_world(world).segments]


def fly(page: RunningPage, **request: Any) -> dict[str, Any]:
    (answer,) = page.ask({"do": "fly", "request": {**USUAL, **request}})
    assert "done" in answer, answer
    done: dict[str, Any] = answer["done"]
    return done


def played(page: RunningPage, key: str) -> dict[str, Any]:
    answer = page.get(f"/api/played/{key}/flight.json.gz")
    assert answer.status == 200
    values: dict[str, Any] = json.loads(gzip.decompress(answer.body))
    return values


def test_a_mission_is_the_command_lines_byte_for_byte(page: RunningPage, world: Path, ids: list[str]) -> None:
    done = fly(page, segments=[ids[1], ids[0]], policies=["skip"], altitude_m=12.0)
    folder = Path(done["folder"])
    chosen = ("--segment", ids[1], "--segment", ids[0], "--policy", "skip", "--altitude", "12")
    before = digests(folder)
    again = pavetwin("fly", world, *SHORT, *chosen)
    assert again.returncode == 0, again.stderr
    assert f"Results in {folder}/" in again.stdout, "the command line writes to the same folder"
    assert digests(folder) == before
    flight = played(page, done["key"])
    assert flight["sentence"] in again.stdout
    assert all(remark in again.stdout for remark in flight["remarks"])
    (table,) = flight["tables"]
    rows = list(zip(*(column["cells"] for column in table["columns"]), strict=True))
    lines = [" ".join(line.split()) for line in again.stdout.splitlines()]
    assert len(rows) == 2
    assert all(" ".join(row) in lines for row in rows)
    assert set(done["files"]) == {path.name for path in folder.iterdir()}
    answer = page.get(f"/api/played/{done['key']}/files/mission.yaml")
    assert answer.body == (folder / "mission.yaml").read_bytes()
    assert answer.headers["Content-Disposition"] == "attachment; filename*=UTF-8''mission.yaml"
    assert page.get(f"/api/played/{done['key']}/files/../mission.yaml").status == 404


@pytest.mark.slow
def test_two_policies_fly_over_the_same_traffic(page: RunningPage, world: Path, ids: list[str]) -> None:
    done = fly(page, segments=ids[:1], policies=["baseline", "hover"])
    before = digests(Path(done["folder"]))
    again = pavetwin("fly", world, *SHORT, "--segment", ids[0], "--policy", "baseline", "--policy", "hover")
    assert again.returncode == 0, again.stderr
    assert digests(Path(done["folder"])) == before
    flight = played(page, done["key"])
    assert [mission["policy"] for mission in flight["missions"]] == ["baseline", "hover"]
    table = pl.read_parquet(Path(done["folder"]) / "mission.parquet")
    assert table["policy"].to_list() == ["baseline", "hover"]
    assert "comparison.png" in done["files"]
    assert "hover/mission.yaml" in done["files"]


@pytest.mark.slow
def test_a_mission_that_was_flown_before_is_played_again(page: RunningPage, ids: list[str]) -> None:
    done = fly(page, segments=ids[:1])
    (listed,) = page.ask({"do": "missions"})
    name = Path(done["folder"]).name
    assert name in listed["done"]["missions"]
    before = digests(Path(done["folder"]))
    (answer,) = page.ask({"do": "play", "mission": name})
    assert answer["done"]["key"] == done["key"]
    assert digests(Path(done["folder"])) == before


@pytest.mark.slow
def test_what_was_missed_is_flown_again_as_the_command_line_does(page: RunningPage, world: Path) -> None:
    done = fly(page, count=2)
    folder = Path(done["folder"])
    (again,) = page.ask({"do": "fly_missed", "key": done["key"], "mission": 0})
    assert Path(again["done"]["folder"]) == folder.with_name(f"{folder.name}-missed")
    other = folder.with_name("by-command")
    flown = pavetwin("fly", "--again", folder / "mission.yaml", "--only-missed", "-o", other)
    assert flown.returncode == 0, flown.stderr
    assert digests(other) == digests(Path(again["done"]["folder"]))
    missed = pl.read_csv(folder / "defects.csv").filter(outcome="missed")["segment"]
    (flight,) = played(page, again["done"]["key"])["missions"]
    assert set(flight["targets"]) == set(missed)
    refused = pavetwin("fly", world, "--only-missed")
    assert refused.returncode == 2
    assert "--again" in refused.stderr


@pytest.mark.slow
def test_a_mission_is_exported_as_the_command_line_does(page: RunningPage, ids: list[str], tmp_path: Path) -> None:
    done = fly(page, segments=ids[:1], policies=["skip", "hover"])
    folder, key = Path(done["folder"]), done["key"]
    (plan,) = page.ask({"do": "export", "key": key, "mission": 0, "what": "csv"})
    written = pavetwin("plan", "export", folder / "skip", "--format", "csv", "-o", tmp_path / "plan")
    assert written.returncode == 0, written.stderr
    assert {Path(name).name for name in plan["done"]["files"]} == {path.name for path in (tmp_path / "plan").iterdir()}
    for name in plan["done"]["files"]:
        answer = page.get(f"/api/played/{key}/made/{name}")
        assert answer.body == (tmp_path / "plan" / Path(name).name).read_bytes()
        assert "attachment" in answer.headers["Content-Disposition"]
    (refused,) = page.ask({"do": "export", "key": key, "mission": 0, "what": "exe"})
    assert "no kind of file 'exe'" in refused["error"]
    (made,) = page.ask({"do": "export", "key": key, "mission": 0, "what": "html"})
    (name,) = made["done"]["files"]
    replayed = pavetwin("replay", folder, "-o", tmp_path / "replay.html")
    assert replayed.returncode == 0, replayed.stderr
    text, own = page.get(f"/api/played/{key}/made/{name}").body, (tmp_path / "replay.html").read_bytes()
    agents = [re.findall(rb'agents-0000.bin.gz">([^<]+)<', each) for each in (text, own)]
    assert agents[0] == agents[1] != []
    for name in ("../flight.json.gz", "%2e%2e/flight.json.gz", "nothing", "map.json.gz/.."):
        assert page.get(f"/api/played/{key}/made/{name}").status == 404


@pytest.mark.parametrize(
    "asked",
    [
        {"do": "export", "key": "x", "mission": 0, "what": "html"},
        {"do": "export", "key": ["x"], "mission": 0, "what": "html"},
        {"do": "fly_missed", "key": "../x", "mission": 0},
        {"do": "fly_missed", "mission": 0},
    ],
)
def test_nothing_is_made_of_a_mission_that_nobody_flew(page: RunningPage, asked: dict[str, Any]) -> None:
    (answer,) = page.ask(asked)
    assert "This mission no longer exists" in answer["error"]


def test_segments_are_drawn_as_the_command_line_draws_them(page: RunningPage, world: Path) -> None:
    (answer,) = page.ask({"do": "estimate", "request": {**USUAL, "count": 2}})
    spec = plan_mission(load_world(world), density="low", seed=1, segments=2)
    assert answer["done"]["targets"] == list(spec.targets)
    assert answer["done"]["segments"] == 2


def test_the_map_has_the_streets_and_the_base_of_a_mission(page: RunningPage, world: Path) -> None:
    values = json.loads(gzip.decompress(page.get("/api/worlds/w0/map").body))
    loaded = load_world(world)
    assert [segment["id"] for segment in values["segments"]] == [segment.id for segment in loaded.segments]
    spec = plan_mission(loaded, density="low", seed=1, segments=1)
    assert spec.base is not None
    assert Point(values["base_m"]).distance(Point(spec.base)) < 0.01
    west, south, east, north = values["bounds_m"]
    for segment in values["segments"]:
        flat = [each / 100 for ring in segment["surface"] for each in ring]
        assert all(west <= x <= east for x in flat[::2])
        assert all(south <= y <= north for y in flat[1::2])


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"segments": ["../x"]}, "no segment or street '../x'"),
        ({"policies": ["mine.py:Policy"]}, "policies"),
        ({"policies": ["/etc/passwd"]}, "policies"),
        ({"policies": ["hove"]}, "hover"),
        ({"policies": []}, "policies"),
        ({"sensor": "own.py:Sensor"}, "sensor"),
        ({"sensor": "recal"}, "recall"),
        ({"aircraft": "my.yaml"}, "aircraft"),
        ({"traffic": "rush.rou.xml"}, "rush.rou.xml"),
        ({"traffic": "los-Z"}, "Z"),
        ({"mix": "../../mix"}, "mix"),
        ({"plugins": ["x.py"]}, "unknown key 'plugins'"),
        ({"output": "/tmp"}, "unknown key 'output'"),
        ({"altitude_m": 500}, "120 m or lower"),
        ({"altitude_m": "NaN"}, "altitude_m"),
        ({"seed": -1}, "seed"),
        ({"count": 10**9}, "count"),
        ({"date": "1066-10-14"}, "date"),
        ({"segments": ["s" * 10_000]}, "segments"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(page: RunningPage, request_: dict[str, Any], words: str) -> None:
    (answer,) = page.ask({"do": "fly", "request": {**USUAL, **request_}})
    assert words in answer["error"]
    assert "\n" not in answer["error"]
    assert "Unexpected" not in answer["error"]


@pytest.mark.parametrize(
    "task",
    [
        {"do": "rm"},
        {"do": "map", "file": "/tmp/x"},
        {"do": "fly"},
        {"do": "fly", "request": []},
        {"do": "fly", "world": "../w0", "request": {}},
        {"do": "fly", "world": ["w0"], "request": {}},
        {"do": "play", "mission": "../../x"},
        {"do": "play", "mission": {"a": 1}},
        {"do": "play"},
        {"do": ["fly"]},
        {},
    ],
)
def test_a_task_that_is_none_is_refused(page: RunningPage, task: dict[str, Any]) -> None:
    (answer,) = page.ask(task)
    assert answer["error"]
    assert "Unexpected" not in answer["error"]


@pytest.mark.parametrize(
    "message", ["", "{", "[]", "7", '{"id": "x"}', '{"id": true}', "[" * 50_000, "x" * 300_000, b"\0"]
)
def test_a_message_that_is_none_ends_its_page_alone(page: RunningPage, message: str | bytes) -> None:
    async def send() -> str | bytes | None:
        client = await page.connect()
        await client.write_message(message, binary=isinstance(message, bytes))
        return await client.read_message()

    assert asyncio.run(send()) is None
    assert page.ask({"do": "missions"})[0]["done"]


def test_32_pages_at_once_are_served(page: RunningPage) -> None:
    with ThreadPoolExecutor(32) as clients:
        answers = list(clients.map(lambda _: page.ask({"do": "missions"})[0], range(32)))
    assert all("done" in answer for answer in answers)
    assert len(task_processes()) <= 3


@pytest.mark.slow
def test_32_pages_that_compute_at_once_are_served(page: RunningPage, ids: list[str]) -> None:
    """Estimates, over few processes: the same as one page alone gets."""

    def estimate(number: int) -> dict[str, Any]:
        return page.ask({"do": "estimate", "request": {**USUAL, "segments": [ids[number % 4]]}})[0]

    alone = [estimate(number) for number in range(4)]
    assert len({answer["done"]["time_s"] for answer in alone}) > 1
    with ThreadPoolExecutor(32) as clients:
        answers = list(clients.map(estimate, range(32)))
    assert answers == alone * 8
    assert len(task_processes()) <= 3


def test_one_page_does_not_take_all(page: RunningPage) -> None:
    async def flood() -> list[dict[str, Any]]:
        client = await page.connect()
        for number in range(12):
            await client.write_message(json.dumps({"id": number, "world": "w0", "do": "missions"}))
        answers = []
        while len(answers) < 12:
            answer = json.loads(await client.read_message() or "{}")
            if {"done", "error"} & answer.keys():
                answers.append(answer)
        client.close()
        return answers

    refused = [answer for answer in asyncio.run(flood()) if "Too much" in answer.get("error", "")]
    assert refused


def test_a_client_that_never_reads_is_no_burden(page: RunningPage) -> None:
    before = resident_bytes()
    with socket.create_connection(("127.0.0.1", page.port)) as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for _ in range(50):
            client.sendall(f"GET /static/vendor.js HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\n".encode())
            client.sendall(f"Cookie: {page.cookie['Cookie']}\r\n\r\n".encode())
        assert page.get("/").status == 200
        assert resident_bytes() - before < 15e6, "36 MB are not held for who does not take them"


def task_processes() -> list[int]:
    return [child for child in children(os.getpid()) if b"app.task_process" in command_line(child)]


def recording() -> int:
    """The process that records for a task, once there is one."""
    assert is_over(lambda: any(simulations(owner) for owner in task_processes()))
    return next(one for owner in task_processes() for one in simulations(owner))


@pytest.mark.slow
@pytest.mark.parametrize("how", ["cancel", "disconnect"])
def test_what_is_cancelled_leaves_no_process_and_no_file(
    page: RunningPage, world: Path, ids: list[str], how: str
) -> None:
    shutil.rmtree(world / "missions", ignore_errors=True)
    before = sorted(path.name for path in page.session.folder.iterdir())
    simulating: list[int] = []

    async def fly_and_stop() -> None:
        client = await page.connect()
        request = {"traffic": "high", "seed": 100 + len(how), "segments": ids}
        asked = asyncio.create_task(result_of(client, {"id": 1, "world": "w0", "do": "fly", "request": request}))
        simulating.append(await asyncio.to_thread(recording))
        if how == "cancel":
            await client.write_message(json.dumps({"id": 1, "do": "cancel"}))
            assert await asked == {"id": 1, "cancelled": True}
        client.close()
        await asked

    asyncio.run(fly_and_stop())
    assert is_over(lambda: all(is_gone(process) for process in simulating))
    assert is_over(lambda: not any(simulations(owner) for owner in task_processes()))
    assert not (world / "missions").exists()
    assert sorted(path.name for path in page.session.folder.iterdir()) == before


@pytest.mark.slow
def test_a_task_whose_process_dies_is_reported_and_the_next_one_runs(page: RunningPage, ids: list[str]) -> None:
    async def fly_and_kill() -> dict[str, Any]:
        client = await page.connect()
        request = {"traffic": "high", "seed": 200, "segments": ids}
        asked = asyncio.create_task(result_of(client, {"id": 1, "world": "w0", "do": "fly", "request": request}))
        await asyncio.to_thread(recording)
        for owner in task_processes():
            if simulations(owner):
                os.kill(owner, signal.SIGKILL)
        answer = await asked
        client.close()
        return answer

    assert "has died" in asyncio.run(fly_and_kill())["error"]
    assert page.ask({"do": "estimate", "request": {**USUAL, "segments": ids[:1]}})[0]["done"]


@pytest.mark.slow
def test_the_end_of_the_server_ends_all_and_leaves_nothing(world: Path) -> None:
    with running_page([world]) as own:
        assert own.ask({"do": "estimate", "request": USUAL})[0]["done"]
        mine = task_processes()
        folder = own.session.folder
        assert folder.is_dir()
        started = time.monotonic()
    assert time.monotonic() - started < 60
    assert not folder.exists()
    assert is_over(lambda: all(is_gone(process) for process in mine if process not in task_processes()))
