"""Maps that a browser sends: built as the command line builds them, or refused with nothing left of them."""

import asyncio
import errno
import gzip
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import osmium
import pytest

from pavetwin.app import uploads
from pavetwin.app.requests import LARGEST_BYTES
from pavetwin.app.town_build import LARGEST_UNPACKED_BYTES, check_map
from pavetwin.errors import PaveTwinError
from scenes.command_line import pavetwin
from scenes.folders import digests
from scenes.page import RunningPage, running_page
from scenes.processes import children, command_line, is_gone, is_over, resident_bytes

TOO_MANY = 101_000_000
CROSS = (Path(__file__).parents[1] / "scenes" / "cross.osm").read_bytes()


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The folder that new towns go to, with something beside it."""
    (tmp_path / "beside").mkdir()
    return tmp_path / "worlds"


@pytest.fixture
def page(place: Path) -> Iterator[RunningPage]:
    with running_page([], place) as running:
        yield running


@dataclass
class Sending:
    """A page that requests a town and sends its map, with the messages that it receives."""

    page: RunningPage
    reported: list[dict[str, Any]] = field(default_factory=list)
    answer: dict[str, Any] = field(default_factory=dict)
    status: int = 0

    async def run(
        self, town: Any, content: bytes, meanwhile: Callable[[dict[str, Any], Any], Any] | None = None
    ) -> None:
        """Until the task ends, or `meanwhile` closes the page; it is called with each message and the page."""
        client = await self.page.connect()
        await client.write_message(json.dumps({"id": 1, "do": "build", "town": town}))
        sending: asyncio.Task[Any] | None = None
        while (message := await client.read_message()) is not None:
            self.answer = json.loads(message)
            if {"done", "error", "cancelled"} & self.answer.keys():
                break
            self.reported.append(self.answer)
            if "ready" in self.answer and content:
                path = f"/api/maps/{self.answer['ready']['upload']}"
                sending = asyncio.create_task(asyncio.to_thread(self.page.get, path, "POST", content))
            if meanwhile is not None and await meanwhile(self.answer, client):
                break
        client.close()
        if sending is not None:
            self.status = (await sending).status


def town(content: bytes = CROSS, **values: Any) -> dict[str, Any]:
    return {"name": "mine", "kind": ".osm", "bytes": len(content), **values}


def send(page: RunningPage, content: bytes = CROSS, **values: Any) -> dict[str, Any]:
    """The last message about a map that is sent as announced."""
    sending = Sending(page)
    asyncio.run(sending.run(town(content, **values), content))
    return sending.answer


def builders(page: RunningPage) -> list[int]:  # noqa: ARG001 - of this process
    return [child for child in children(os.getpid()) if b"app.task_process" in command_line(child)]


def nothing_is_left(page: RunningPage, place: Path) -> bool:
    held = [path.name for path in page.session.folder.iterdir() if path.name.startswith("map-")]
    return not held and not (place.is_dir() and any(place.iterdir()))


def test_a_map_becomes_the_town_that_the_command_line_builds(page: RunningPage, place: Path, tmp_path: Path) -> None:
    answer = send(page, left_hand=True, parking_rule="north_america")
    assert answer["done"] == {"world": {"id": "w0", "name": "mine"}}
    (tmp_path / "mine.osm").write_bytes(CROSS)
    options = ("--left-hand", "--parking-rule", "north_america")
    built = pavetwin("world", "build", tmp_path / "mine.osm", *options, "-o", tmp_path / "other" / "mine")
    assert built.returncode == 0, built.stderr
    assert digests(place / "mine") == digests(tmp_path / "other" / "mine")
    assert page.get("/api/start").values["worlds"] == [{"id": "w0", "name": "mine"}]
    assert page.get("/api/worlds/w0/map").status == 200
    (estimated,) = page.ask({"do": "estimate", "request": {"count": 1, "seed": 1}})
    assert estimated["done"]["segments"] == 1
    shutil.rmtree(place / "mine")
    assert nothing_is_left(page, place)


@pytest.mark.slow
def test_the_other_forms_of_maps_are_built(page: RunningPage, place: Path, tmp_path: Path) -> None:
    packed, plain = tmp_path / "cross.osm.pbf", tmp_path / "cross.osm"
    plain.write_bytes(CROSS)
    with osmium.SimpleWriter(str(packed)) as writer:
        for each in osmium.FileProcessor(str(plain)):
            writer.add(each)
    assert "done" in send(page, packed.read_bytes(), name="packed", kind=".osm.pbf")
    network = (place / "packed" / "roads.net.xml").read_bytes()
    assert "done" in send(page, network, name="net", kind=".net.xml")
    assert {path.name for path in place.iterdir()} == {"packed", "net"}


@pytest.mark.slow
def test_a_real_map_is_built_and_flown(page: RunningPage, place: Path, shared_file: Callable[[str], Path]) -> None:
    sending, content = Sending(page), shared_file("osm/berlin_neukoelln.osm").read_bytes()
    asyncio.run(sending.run(town(content, name="neukölln"), content))
    assert sending.status == 204
    assert sending.answer["done"]["world"] == {"id": "w0", "name": "neukölln"}
    words = {reported.get("what", "") for reported in sending.reported}
    assert {"Sending the map", "Checking the map", "Building the town: road network"} <= words
    (flown,) = page.ask({"do": "fly", "request": {"count": 1, "seed": 1, "traffic": "low"}})
    assert Path(flown["done"]["folder"]).parent == place / "neukölln" / "missions"


def status_of(page: RunningPage, head: str, key: str = "x") -> int:
    """The answer to the head of a request that is followed by nothing."""
    with socket.create_connection(("127.0.0.1", page.port), timeout=20) as client:
        client.sendall(head_of(page, head, key))
        return int(client.recv(64).split()[1])


def head_of(page: RunningPage, head: str, key: str) -> bytes:
    about = f"Host: 127.0.0.1:{page.port}\r\nCookie: {page.cookie['Cookie']}\r\n"
    return f"POST /api/maps/{key} HTTP/1.1\r\n{about}{head}\r\n\r\n".encode()


@pytest.mark.parametrize(
    ("head", "status"),
    [
        ("Content-Length: 101000000", 413),
        ("Content-Length: 99999999999999999999", 413),
        ("Content-Length: 10", 404),
        ("Transfer-Encoding: chunked", 411),
        ("Content-Length: -1", 411),
    ],
)
def test_what_is_too_large_or_not_announced_is_refused_unread(page: RunningPage, head: str, status: int) -> None:
    assert status_of(page, head) == status
    assert page.get("/api/maps/x").status == 405


def test_101_mb_are_refused_when_they_are_announced(page: RunningPage, place: Path) -> None:
    assert "101 MB" in send(page, b"", bytes=TOO_MANY)["error"]
    assert nothing_is_left(page, place)


CHUNK = b"%x\r\n%s\r\n" % (1 << 20, b"x" * (1 << 20))


@pytest.mark.parametrize(
    ("head", "block", "status"),
    [
        (f"Content-Length: {TOO_MANY}", b"x" * (1 << 20), 413),
        (f"Content-Length: {LARGEST_BYTES}", b"x" * (1 << 20), 404),
        ("Transfer-Encoding: chunked", CHUNK, 411),
        (f"Transfer-Encoding: chunked\r\nContent-Length: {len(CROSS)}", CHUNK, 400),
    ],
    ids=["announced to HTTP", "more than announced to the page", "in chunks", "in chunks and with a length"],
)
def test_101_mb_that_are_sent_are_refused(page: RunningPage, place: Path, head: str, block: bytes, status: int) -> None:
    """A map is on its way, and its address gets more than that has: nothing of it is kept."""
    sending, seen = Sending(page), list[tuple[int, int]]()

    async def overfill(reported: dict[str, Any], client: Any) -> None:
        if "ready" in reported:
            before = resident_bytes()
            seen.append(await asyncio.to_thread(overfilled, page, head, reported["ready"]["upload"], block))
            assert resident_bytes() - before < 20e6
            assert not any(path.stat().st_size for path in page.session.folder.glob("map-*/*"))
            await client.write_message(json.dumps({"id": 1, "do": "cancel"}))

    asyncio.run(sending.run(town(), b"", overfill))
    ((sent, answer),) = seen
    assert answer == status
    assert sent < TOO_MANY, "the server does not take it all"
    assert nothing_is_left(page, place)


@pytest.mark.slow
def test_101_mb_behind_a_map_of_the_announced_size_are_no_part_of_it(page: RunningPage, place: Path) -> None:
    sending, seen = Sending(page), list[tuple[int, int]]()
    head = f"Content-Length: {len(CROSS)}"

    async def overfill(reported: dict[str, Any], client: Any) -> None:  # noqa: ARG001 - the page stays
        if "ready" in reported:
            key = reported["ready"]["upload"]
            seen.append(await asyncio.to_thread(overfilled, page, head, key, b"x" * (1 << 20), CROSS))

    asyncio.run(sending.run(town(), b"", overfill))
    ((sent, answer),) = seen
    assert answer == 204
    assert sent < TOO_MANY
    assert sending.answer["done"] == {"world": {"id": "w0", "name": "mine"}}
    shutil.rmtree(place / "mine")
    assert nothing_is_left(page, place)


def overfilled(page: RunningPage, head: str, key: str, block: bytes, first: bytes = b"") -> tuple[int, int]:
    """Bytes that the server took of 101 MB behind the head of a request, and its answer."""
    with socket.create_connection(("127.0.0.1", page.port), timeout=20) as client:
        client.sendall(head_of(page, head, key) + first)
        sent = 0
        with suppress(ConnectionError):
            while sent < TOO_MANY:
                client.sendall(block)
                sent += len(block)
        try:
            answer = client.recv(64)
        except ConnectionError:  # the answer was lost with the connection: the same head alone has it
            return sent, status_of(page, head, key)
        return sent, int(answer.split()[1])


def blob(kind: bytes, unpacked: bytes, states: int | None = None) -> bytes:
    """A block of a .osm.pbf, and the size that it states."""
    packed = zlib.compress(unpacked, 9)
    body = b"\x10" + number(len(unpacked) if states is None else states) + b"\x1a" + number(len(packed)) + packed
    head = b"\x0a" + number(len(kind)) + kind + b"\x18" + number(len(body))
    return len(head).to_bytes(4, "big") + head + body


def number(value: int) -> bytes:
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + number(rest) if rest else bytes([low])


BLOCK = 1 << 25
BOMB = blob(b"OSMHeader", b"") + (LARGEST_UNPACKED_BYTES // BLOCK + 1) * blob(b"OSMData", bytes(BLOCK))
LIAR = blob(b"OSMHeader", b"") + 20 * blob(b"OSMData", bytes(BLOCK), states=100)


@pytest.mark.parametrize(
    ("content", "kind", "words"),
    [
        (CROSS[: len(CROSS) // 2], ".osm", "cut short"),
        (b"<html><body>Not found</body></html>", ".osm", "mine.osm"),
        (b"PK\3\4" + bytes(100), ".osm", "not XML"),
        (gzip.compress(CROSS), ".osm", "gzip"),
        (b"<?xml version='1.0' encoding='utf-16'?><osm version='0.6'/>", ".osm", "UTF-8"),
        ("<osm version='0.6'/>".encode("utf-16"), ".osm", "not XML"),
        (b"<!DOCTYPE osm [<!ENTITY a 'b'>]><osm version='0.6'>&a;</osm>", ".osm", "entities"),
        (b"<net><include href='/etc/passwd'/></net>", ".net.xml", "includes other files"),
        (b"<!DOCTYPE net [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><net>&x;</net>", ".net.xml", "entities"),
        (b" " * (1 << 20) + b"<!DOCTYPE x>", ".osm", "not XML"),
        (b"<osm>" + b" " * (1 << 20) + b"<!DOCTYPE x>", ".osm", "entities"),
        (b"<osm></osm>", ".net.xml", "not a SUMO network"),
        (CROSS, ".osm.pbf", ".osm.pbf"),
        (BOMB, ".osm.pbf", "when it is unpacked"),
        (BOMB[:-5], ".osm.pbf", "cut short"),
        (LIAR, ".osm.pbf", "cannot be read"),
        (b"\0\0\0\1\xff", ".osm.pbf", "no .osm.pbf"),
        (b"\xff\xff\xff\xff", ".osm.pbf", "no .osm.pbf"),
    ],
)
def test_a_map_that_is_none_is_refused_in_one_line(tmp_path: Path, content: bytes, kind: str, words: str) -> None:
    source = tmp_path / f"mine{kind}"
    source.write_bytes(content)
    with pytest.raises(PaveTwinError, match=re.escape(words)) as refused:
        check_map(source)
    assert "\n" not in str(refused.value)


def test_a_refused_map_is_named_and_leaves_nothing(page: RunningPage, place: Path) -> None:
    empty = b"<osm version='0.6'></osm>"
    for content, kind, words in (
        (CROSS[:2000], ".osm", "'mine.osm' cannot be read"),
        (empty, ".osm", "'mine.osm' has no streets"),
        (BOMB, ".osm.pbf", "unpacked"),
    ):
        answer = send(page, content, kind=kind)
        assert words in answer["error"]
        assert str(page.session.folder) not in answer["error"]
    assert nothing_is_left(page, place)
    assert not builders(page)


def test_too_large_an_area_is_refused(tmp_path: Path) -> None:
    """A street of two nodes, nine kilometres apart on each axis; and nodes apart from streets are of no account."""

    def written(last: str, tags: str) -> Path:
        nodes = f"<node id='1' lat='52' lon='13'/>{last}<node id='3' lat='10' lon='10'/>"
        way = f"<way id='4'><nd ref='1'/><nd ref='2'/>{tags}</way>"
        source = tmp_path / "wide.osm"
        source.write_text(f"<osm version='0.6'>{nodes}{way}</osm>")
        return source

    street, far = "<tag k='highway' v='residential'/>", "<node id='2' lat='52.081' lon='13.131'/>"
    with pytest.raises(PaveTwinError, match=r"'wide.osm' spread over 81 km²"):
        check_map(written(far, street))
    check_map(written(far, "<tag k='waterway' v='river'/>"))
    check_map(written("<node id='2' lat='52.02' lon='13.03'/>", street))


@pytest.mark.parametrize(
    "values",
    [
        {"name": "../mine"},
        {"name": "a/b"},
        {"name": ".."},
        {"name": ".hidden"},
        {"name": ""},
        {"name": "mine\n"},
        {"name": "x" * 61},
        {"name": "/etc/mine"},
        {"name": ["mine"]},
        {"kind": ".osm.gz"},
        {"kind": "/../x.osm"},
        {"bytes": 0},
        {"bytes": -5},
        {"bytes": "many"},
        {"parking_rule": "/etc/rule.yaml"},
        {"parking_rule": "rule.yaml"},
        {"path": "/tmp/x.osm"},
        {"seed": 1},
    ],
)
def test_no_path_and_nothing_else_is_taken(page: RunningPage, place: Path, values: dict[str, Any]) -> None:
    answer = send(page, b"", **values)
    assert "error" in answer
    assert "\n" not in answer["error"]
    assert nothing_is_left(page, place)
    assert [path.name for path in place.parent.iterdir()] == ["beside"]


def test_a_town_that_is_there_is_not_replaced(page: RunningPage, place: Path) -> None:
    (place / "mine").mkdir(parents=True)
    assert "is a town 'mine' already" in send(page)["error"]
    assert list((place / "mine").iterdir()) == []


@pytest.mark.parametrize("how", ["cancel", "disconnect"])
@pytest.mark.parametrize("when", ["Sending", "Building"])
def test_what_is_cancelled_leaves_no_process_and_no_file(page: RunningPage, place: Path, how: str, when: str) -> None:
    seen: list[int] = []

    async def stop(reported: dict[str, Any], client: Any) -> bool:
        is_then = "ready" in reported if when == "Sending" else reported.get("what", "").startswith("Building the town")
        if not is_then:
            return False
        assert any(path.name.startswith("map-") for path in page.session.folder.iterdir())
        seen.extend(builders(page))
        if how == "cancel":
            await client.write_message(json.dumps({"id": 1, "do": "cancel"}))
        return how == "disconnect"

    sending = Sending(page)
    asyncio.run(sending.run(town(), b"" if when == "Sending" else CROSS, stop))
    if how == "cancel":
        assert sending.answer == {"id": 1, "cancelled": True}
    assert is_over(lambda: nothing_is_left(page, place))
    assert bool(seen) == (when == "Building")
    assert is_over(lambda: all(map(is_gone, seen)))


def test_a_truncated_map_is_reported(page: RunningPage, place: Path) -> None:
    async def break_off(reported: dict[str, Any], client: Any) -> None:  # noqa: ARG001 - the page stays
        if "ready" in reported:
            with socket.create_connection(("127.0.0.1", page.port)) as line:
                about = f"Host: 127.0.0.1:{page.port}\r\nCookie: {page.cookie['Cookie']}\r\n"
                head = (
                    f"POST /api/maps/{reported['ready']['upload']} HTTP/1.1\r\n{about}Content-Length: {len(CROSS)}\r\n"
                )
                line.sendall(head.encode() + b"\r\n" + CROSS[:1000])

    sending = Sending(page)
    asyncio.run(sending.run(town(), b"", break_off))
    assert "did not arrive whole" in sending.answer["error"]
    assert nothing_is_left(page, place)


def test_a_map_is_sent_once(page: RunningPage) -> None:
    async def send_twice(reported: dict[str, Any], client: Any) -> None:
        if reported.get("what", "").startswith("Building"):
            again = await asyncio.to_thread(page.get, f"/api/maps/{keys[0]}", "POST", CROSS)
            assert again.status == 404
            await client.write_message(json.dumps({"id": 1, "do": "cancel"}))
        elif "ready" in reported:
            keys.append(reported["ready"]["upload"])

    keys: list[str] = []
    sending = Sending(page)
    asyncio.run(sending.run(town(), CROSS, send_twice))
    assert (sending.status, len(keys)) == (204, 1)


def test_few_maps_are_on_their_way_at_once(page: RunningPage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "AT_ONCE", 1)

    async def announce_another(reported: dict[str, Any], client: Any) -> None:
        if "ready" in reported:
            other = Sending(page)
            await other.run(town(name="other"), b"")
            assert "Other maps are being built" in other.answer["error"]
            await client.write_message(json.dumps({"id": 1, "do": "cancel"}))

    asyncio.run(Sending(page).run(town(), b"", announce_another))


@pytest.mark.parametrize("what", ["folder", "file"])
def test_a_full_disk_is_reported_and_takes_no_other_maps_place(
    page: RunningPage, place: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    def fail(*_: Any, **__: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as full:
        if what == "folder":
            full.setattr(uploads.tempfile, "mkdtemp", fail)
        else:
            full.setattr(uploads.Path, "open", fail)
        for _ in range(uploads.AT_ONCE + 1):
            assert "No space left on device. Free some space" in send(page, b"", bytes=9)["error"]
    monkeypatch.setattr(uploads, "SENDING_S", 0.1)
    assert "did not arrive within" in send(page, b"", bytes=9)["error"]
    assert nothing_is_left(page, place)


def test_what_takes_too_long_is_given_up(page: RunningPage, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "SENDING_S", 0.3)
    assert "did not arrive within" in send(page, b"", bytes=9)["error"]
    monkeypatch.setattr(uploads, "SENDING_S", 60)
    monkeypatch.setattr(uploads, "BUILDING_S", 0.5)
    assert "takes longer than" in send(page)["error"]
    assert nothing_is_left(page, place)
    assert not builders(page)


def test_the_process_that_builds_may_use_only_so_much(page: RunningPage) -> None:
    limits: list[str] = []

    async def look(reported: dict[str, Any], client: Any) -> None:
        if reported.get("what") == "Checking the map":
            limits.extend(Path(f"/proc/{process}/limits").read_text() for process in builders(page))
            await client.write_message(json.dumps({"id": 1, "do": "cancel"}))

    asyncio.run(Sending(page).run(town(), CROSS, look))
    (own,) = limits
    assert re.search(r"Max address space +4294967296 ", own)
    assert re.search(r"Max cpu time +600 ", own)
    assert re.search(r"Max file size +2147483648 ", own)


def test_an_uploads_processor_time_is_limited(tmp_path: Path) -> None:
    """In a process of its own, which is over its limit as soon as it has one."""
    (tmp_path / "mine.osm").write_bytes(CROSS)
    words = """
import sys
from pathlib import Path
from pavetwin.app import town_build
from pavetwin.errors import PaveTwinError
town_build.PROCESSOR_S = 1
place = Path(sys.argv[1])
try:
    town_build.build_town(place / "mine.osm", place / "town", {}, lambda share, what: sum(range(3_000_000)))
except PaveTwinError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", words, tmp_path], capture_output=True, text=True, check=False)
    assert "of processor time" in done.stdout, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine.osm"]
