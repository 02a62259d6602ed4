"""`pavetwin serve` as a process: it says where it listens, answers, and ends when told to."""

import json
import re
import signal
import socket
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.request import urlopen

import pytest

from scenes.command_line import command, pavetwin, plain_refusal
from scenes.drawn_detector import FILE


def test_it_listens_answers_and_ends() -> None:
    """Told to end while it answers: wherever in the loop the signal arrives."""
    words = command("serve", "--model", FILE, "--port", 0, "--overview")
    with (
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
        ThreadPoolExecutor(1) as client,
    ):
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.search(r"Listening at (http://127\.0\.0\.1:\d+/)", line)
            assert found is not None, line
            with urlopen(f"{found[1]}health", timeout=10) as answer:
                told = json.load(answer)
            assert (told["model"], told["overview"]) == ("rectangles.onnx", True)
            asked = client.submit(ask_until_it_ends, f"{found[1]}health")
            time.sleep(0.1)
            process.send_signal(signal.SIGTERM)
            assert process.wait(10) == 143
        finally:
            process.kill()
        assert asked.result() > 0


def ask_until_it_ends(address: str) -> int:
    """How many times it answered."""
    count = 0
    try:
        while True:
            with urlopen(address, timeout=10) as answer:
                answer.read()
            count += 1
    except OSError:
        return count


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("--model", "gone.onnx"),
            "--model: There is no model 'gone.onnx': name one that ships",
        ),
        (("--model", FILE, "--max-mb", "0"), "--max-mb 0: it is above 0"),
        (("--model", FILE, "--max-megapixels", "-1"), "--max-megapixels -1: it is above 0"),
        (("--model", FILE, "--host", "256.0.0.1"), "--host 256.0.0.1: no listening there"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(tmp_path: Path, arguments: tuple[object, ...], words: str) -> None:
    assert words in plain_refusal(pavetwin("serve", *arguments, cwd=tmp_path))


def test_a_port_in_use_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert f"--port {port}: it is in use" in plain_refusal(pavetwin("serve", "--model", FILE, "--port", port))
