"""`pavetwin app` as a process: it prints its address, answers, and ends with all that it started."""

import os
import re
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from scenes.command_line import command, pavetwin, plain_refusal
from scenes.processes import children, command_line, is_gone, is_over


@contextmanager
def started(folder: Path, *words: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process, and the address that it prints."""
    typed = command("app", *words, "--port", 0, "--no-browser")
    own = {**os.environ, "TMPDIR": str(folder)}
    with subprocess.Popen(
        typed, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, env=own
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.search(r"The page is at (http://127\.0\.0\.1:\d+/\?token=[\w-]{20,});", line)
            assert found is not None, line
            yield process, found[1]
        finally:
            process.kill()


def task_processes(owner: int) -> list[int]:
    return [child for child in children(owner) if b"app.task_process" in command_line(child)]


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_the_page_needs_the_token_and_ends_with_its_processes(tmp_path: Path, how: signal.Signals) -> None:
    with started(tmp_path) as (process, address):
        with urlopen(address, timeout=20) as answer:
            assert b"PaveTwin" in answer.read()
        with pytest.raises(HTTPError, match="403"):
            urlopen(address.partition("?")[0], timeout=20)
        assert is_over(lambda: bool(task_processes(process.pid)))
        mine = task_processes(process.pid)
        process.send_signal(how)
        assert process.wait(30) == {signal.SIGTERM: 143, signal.SIGINT: 130, signal.SIGKILL: -9}[how]
    assert is_over(lambda: all(map(is_gone, mine)))


def test_an_address_for_other_machines_is_printed(tmp_path: Path) -> None:
    with started(tmp_path, "--host", "0.0.0.0") as (process, address):
        assert process.stdout is not None
        found = re.search(r"Other machines open http://(.+:\d+)(/\?token=[\w-]{20,})$", process.stdout.readline())
        assert found is not None
        assert not found[1].startswith("127.")
        asked = Request(address.partition("/?")[0] + found[2], headers={"Host": found[1]})
        with urlopen(asked, timeout=20) as answer:
            assert b"PaveTwin" in answer.read()


def test_the_next_start_removes_files_of_a_killed_server(tmp_path: Path) -> None:
    def held() -> set[Path]:
        return set(tmp_path.glob(".pavetwin-app-*"))

    with started(tmp_path) as (process, _):
        (left,) = held()
        (left / "map-1").mkdir()
        process.kill()
        process.wait(30)
    assert held() == {left}
    with started(tmp_path) as (first, _):
        (own,) = held() - {left}
        assert not left.exists()
        with started(tmp_path) as (second, _):
            assert own in held(), "one whose server runs stays"
            second.terminate()
            second.wait(30)
        first.terminate()
        first.wait(30)
    assert held() == set()


def test_worlds_are_found_in_the_folder_of_that_name(tmp_path: Path) -> None:
    (tmp_path / "worlds" / "notes").mkdir(parents=True)
    with started(tmp_path) as (_, address), urlopen(address, timeout=20) as answer:
        assert answer.status == 200


def test_a_folder_without_a_world_is_refused_in_one_line(tmp_path: Path) -> None:
    assert "make one with `pavetwin world build" in plain_refusal(pavetwin("app", "gone", cwd=tmp_path))
    (tmp_path / "empty").mkdir()
    assert "is not a world" in plain_refusal(pavetwin("app", "empty", cwd=tmp_path))


def test_an_address_that_cannot_be_taken_is_refused(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        reported = plain_refusal(pavetwin("app", "--port", port, "--no-browser", cwd=tmp_path))
        assert f"--port {port}: it is in use" in reported
    reported = plain_refusal(pavetwin("app", "--host", "256.0.0.1", "--no-browser", cwd=tmp_path))
    assert "--host 256.0.0.1: no listening there" in reported
