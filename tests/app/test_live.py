"""The WebSocket of a page: one flight at a time, an answer to all that fails, and little memory for who never reads."""

import asyncio
import base64
import errno
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from tornado.websocket import WebSocketClientConnection

from pavetwin.app import live
from pavetwin.app.frames import FrameRenderer
from pavetwin.app.task_pool import KeptProcess
from scenes.page import RunningPage, result_of
from scenes.processes import resident_bytes

READY = {"key": "k", "folder": "f", "files": ["mission.yaml"]}

FRAME_BYTES = 82_000
FRAMES = 3000


class Runs:
    """In place of what a session does: tasks that end when they are cancelled, or at once."""

    def __init__(self) -> None:
        self.begun = list[str]()

    async def __call__(self, asked: Mapping[str, Any], on_progress: Callable[[Any], None], printed: Any) -> Any:  # noqa: ARG002
        self.begun.append(asked["do"])
        if asked["do"] == "estimate":
            return {"minutes": 1}
        if asked.get("ready"):
            on_progress({"ready": READY})
        on_progress({"share": 0.0, "what": "begun"})
        return await asyncio.Future()


@pytest.fixture
def runs(page: RunningPage, monkeypatch: pytest.MonkeyPatch) -> Runs:
    made = Runs()
    monkeypatch.setattr(page.session, "run", made)
    return made


async def ask(client: WebSocketClientConnection, number: int, do: str, **more: Any) -> None:
    await client.write_message(json.dumps({"id": number, "do": do, "world": "w0", **more}))


async def next_message(client: WebSocketClientConnection) -> dict[str, Any]:
    message: dict[str, Any] = json.loads(await asyncio.wait_for(client.read_message(), 20) or "{}")
    return message


async def answered(client: WebSocketClientConnection) -> dict[str, Any]:
    """The next message other than progress, which is left out where the one before has not been read."""
    while "share" in (message := await next_message(client)):
        pass
    return message


@pytest.mark.parametrize("first", ["fly", "play", "fly_missed", "pilot", "drive"])
@pytest.mark.parametrize("second", ["fly", "pilot"])
def test_a_page_has_one_flight_at_a_time(page: RunningPage, runs: Runs, first: str, second: str) -> None:
    async def fly_twice() -> None:
        client, other = await page.connect(), await page.connect()
        await ask(client, 1, first)
        assert (await next_message(client))["what"] == "begun"
        await ask(client, 2, second)
        refused = await answered(client)
        assert "has a flight that is going on" in refused["error"]
        assert refused["id"] == 2
        await ask(client, 3, "estimate")
        assert await next_message(client) == {"id": 3, "done": {"minutes": 1}}
        await ask(other, 1, "fly")
        assert (await next_message(other))["what"] == "begun", "another page has flights of its own"
        await ask(client, 1, "cancel")
        assert await next_message(client) == {"id": 1, "cancelled": True}
        await ask(client, 4, second)
        assert (await next_message(client))["what"] == "begun"
        client.close()
        other.close()

    asyncio.run(fly_twice())
    assert runs.begun == [first, "estimate", "fly", second]


def test_a_mission_that_is_ready_is_kept_when_its_pictures_are_cancelled(page: RunningPage, runs: Runs) -> None:
    async def fly_and_cancel() -> None:
        client = await page.connect()
        await ask(client, 1, "fly", ready=True)
        assert await answered(client) == {"id": 1, "ready": READY}
        await ask(client, 2, "fly")
        await ask(client, 1, "cancel")
        assert await answered(client) == {"id": 1, "done": READY}
        await ask(client, 3, "fly")
        assert "going on" in (await answered(client))["error"], "the second is not ready"
        client.close()

    asyncio.run(fly_and_cancel())
    assert runs.begun == ["fly", "fly"], "the next may be flown while the pictures are drawn"


@pytest.mark.parametrize("do", ["pilot", "drive", "build"])
def test_what_is_ready_before_it_is_whole_is_not_kept(page: RunningPage, runs: Runs, do: str) -> None:  # noqa: ARG001
    async def begin_and_cancel() -> None:
        client = await page.connect()
        await ask(client, 1, do, ready=True)
        assert await answered(client) == {"id": 1, "ready": READY}
        await ask(client, 1, "cancel")
        assert await answered(client) == {"id": 1, "cancelled": True}
        client.close()

    asyncio.run(begin_and_cancel())


@pytest.mark.slow
def test_a_flight_that_is_cancelled_while_its_maps_are_drawn_is_whole(page: RunningPage) -> None:
    request = {"traffic": "low", "seed": 5, "count": 1, "policies": ["baseline", "skip"]}

    async def fly_and_cancel() -> dict[str, Any]:
        client = await page.connect()

        def cancel(message: dict[str, Any]) -> None:
            if "ready" in message:
                client.write_message(json.dumps({"id": 1, "do": "cancel"}))

        answer = await result_of(client, {"id": 1, "do": "fly", "world": "w0", "request": request}, cancel)
        client.close()
        return answer

    done = asyncio.run(fly_and_cancel())["done"]
    assert "comparison.png" not in done["files"]
    assert {"mission.parquet", "baseline/mission.yaml", "skip/mission.yaml"} <= set(done["files"])
    folder = Path(done["folder"])
    assert not list(folder.rglob(".*")), "nothing is half written"
    for name in done["files"]:
        assert page.get(f"/api/played/{done['key']}/files/{name}").status == 200
    (played,) = page.ask({"do": "play", "mission": folder.name})
    assert played["done"]["key"] == done["key"]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "No space left on device. Free some space or try it again."),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE)), "Too many open files. Try it again."),
        (ValueError("two\nlines"), "Unexpected failure: ValueError: two lines. Please report it."),
    ],
)
@pytest.mark.parametrize("do", ["build", "frame"])
def test_whatever_fails_is_answered(
    page: RunningPage, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str, do: str
) -> None:
    async def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr(page.session, "frame" if do == "frame" else "run", fail)

    async def ask_twice() -> None:
        client = await page.connect()
        for number in range(2):
            await ask(client, number, do)
            answer = await next_message(client)
            assert answer["id"] == number
            assert answer["error"].endswith(words)
        client.close()

    asyncio.run(ask_twice())


def test_a_frame_whose_process_breaks_is_answered_and_the_next_one_rendered() -> None:
    class Process(KeptProcess):
        async def run(self, task: Mapping[str, Any], **_: Any) -> Mapping[str, Any]:
            if task["capture"] == 0:
                raise ValueError("a line that is too long")
            return task

    async def render() -> Mapping[str, Any]:
        renderer = FrameRenderer(Process())
        with pytest.raises(ValueError, match="too long"):
            await asyncio.wait_for(renderer.frame("page", {"capture": 0}), 5)
        return await asyncio.wait_for(renderer.frame("page", {"capture": 1}), 5)

    assert asyncio.run(render()) == {"capture": 1}


def test_half_a_character_is_refused_as_any_other_name(page: RunningPage) -> None:
    """Half a pair of surrogates, which JSON can say and UTF-8 cannot: the answer repeats it."""
    half = "\ud800"
    asked: list[dict[str, Any]] = [
        {"do": half},
        {"do": "fly", "world": half},
        {"do": "fly", "request": {"segments": [half]}},
        {"do": "choose", "text": half},
    ]
    for answer in page.ask(*asked):
        assert answer["error"]
        assert "Unexpected" not in answer["error"]
        assert "has died" not in answer["error"]


class Unread:
    """A page that asks and never reads."""

    def __init__(self, page: RunningPage) -> None:
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.settimeout(20)
        self._socket.connect(("127.0.0.1", page.port))
        lines = (
            "GET /live HTTP/1.1",
            f"Host: 127.0.0.1:{page.port}",
            f"Cookie: {page.cookie['Cookie']}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}",
        )
        self._socket.sendall("\r\n".join([*lines, "\r\n"]).encode())
        assert b" 101 " in self._socket.recv(64)

    def __enter__(self) -> "Unread":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def ask(self, *tasks: dict[str, Any]) -> None:
        """Frames of text under a mask of zeros."""
        frames = bytearray()
        for task in tasks:
            text = json.dumps(task).encode()
            assert len(text) < 126
            frames += bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text
        self._socket.sendall(frames)


def test_frames_that_nobody_reads_do_not_pile_up(page: RunningPage, monkeypatch: pytest.MonkeyPatch) -> None:
    shown, frame = threading.Semaphore(0), {"jpeg": "x" * FRAME_BYTES}

    async def kept(*_: Any) -> Mapping[str, Any]:
        shown.release()
        return frame

    monkeypatch.setattr(page.session, "frame", kept)
    before = resident_bytes()
    with Unread(page) as client:
        client.ask(*({"id": number, "do": "frame"} for number in range(FRAMES)))
        for _ in range(FRAMES):
            assert shown.acquire(timeout=20)
        assert resident_bytes() - before < 30e6, f"{FRAMES * FRAME_BYTES / 1e6:.0f} MB are not held for who reads none"
        assert page.ask({"do": "missions"})[0]["done"]


def test_of_frames_that_are_read_late_the_latest_is_sent(page: RunningPage, monkeypatch: pytest.MonkeyPatch) -> None:
    """What waits in the sockets is sent; of the frames behind it only the last."""

    async def kept(_: object, asked: Mapping[str, Any]) -> Mapping[str, Any]:
        return {"number": asked["number"], "jpeg": "x" * FRAME_BYTES}

    monkeypatch.setattr(page.session, "frame", kept)
    count = 400

    async def look() -> dict[int, dict[str, Any]]:
        client = await page.connect()
        for number in range(count):
            await client.write_message(json.dumps({"id": number, "do": "frame", "number": number}))
        answers: dict[int, dict[str, Any]] = {}
        while len(answers) < count:
            answer = await next_message(client)
            answers[answer.pop("id")] = answer
        client.close()
        return answers

    answers = asyncio.run(look())
    assert answers[count - 1]["done"]["number"] == count - 1
    assert all(answer == {"cancelled": True} or answer["done"]["number"] == at for at, answer in answers.items())


def test_who_reads_nothing_is_closed(page: RunningPage, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a page lets wait is limited, whatever it asks for."""
    codes, close = list[int | None](), live.LiveHandler.close

    def closed(self: live.LiveHandler, code: int | None = None, reason: str | None = None) -> None:
        codes.append(code)
        close(self, code, reason)

    async def answer(*_: Any) -> Mapping[str, Any]:
        return {"words": "x" * 1_000_000}

    monkeypatch.setattr(live, "UNREAD", 2_000_000)
    monkeypatch.setattr(live.LiveHandler, "close", closed)
    monkeypatch.setattr(page.session, "run", answer)
    before = resident_bytes()
    with Unread(page) as client:
        for number in range(60):
            client.ask({"id": number, "do": "missions"})
            time.sleep(0.01)
        assert codes
        assert set(codes) == {1008}
        assert resident_bytes() - before < 20e6, "60 MB are not held"
