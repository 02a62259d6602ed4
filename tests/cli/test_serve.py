"""`pavetwin serve` as a process: its address, its answers, its memory and its end."""

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from struct import pack
from urllib.request import urlopen

import pytest
from benchmarks.process import peak_mib
from PIL import Image

from scenes.command_line import command, pavetwin, plain_refusal
from scenes.drawn_detector import FILE, drawn


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


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the peak of a process's memory is read from /proc")

KIND = "multipart/form-data; boundary=x"
LARGEST_MIB = 244
"""That all requests hold together by default, `ServerLimits.held_mb`."""


def test_its_memory_stays_bounded_and_it_answers_on() -> None:
    """A whole picture of 200 megapixels, uploads of 100 MB from many at once, also to other addresses, hung clients,
    damaged files."""
    words = command("serve", "--model", FILE, "--port", 0)
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://127\.0\.0\.1:(\d+)/", process.stdout.readline())
            assert found is not None
            port = int(found[1])
            street = encoded(drawn((96, 64), ("car", (20, 12, 50, 56))))
            assert sent(port, street) == 200
            begun = peak_mib(process.pid)
            hung = [socket.create_connection(("127.0.0.1", port)) for _ in range(8)]
            for each in hung:
                each.sendall(f"POST /predict HTTP/1.1\r\nHost: a\r\nContent-Type: {KIND}\r\n".encode())
            huge = grey_png(20_000, 10_000)
            assert [sent(port, each) for each in (huge, b"text", street[:-40])] == [413, 415, 400]
            with ThreadPoolExecutor(32) as clients:
                large = list(clients.map(lambda _: sent(port, bytes(100_000_000)), range(4)))
                astray = list(clients.map(lambda path: sent(port, bytes(100_000_000), path), ["/health", "/", "/x"]))
                many = list(clients.map(lambda _: sent(port, street), range(32)))
            assert (set(large), astray, set(many)) == ({413}, [405, 405, 404], {200})
            for each in hung:
                each.close()
            assert sent(port, street) == 200
            grown = peak_mib(process.pid) - begun
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(20)
    assert grown < LARGEST_MIB  # the pixels of the large picture alone would take 600 MB, the uploads 400 MB


def sent(port: int, content: bytes, path: str = "/predict") -> int:
    """The status of the answer to a file."""
    body = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.jpg"\r\n\r\n' + content + b"\r\n--x--\r\n"
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        with suppress(BrokenPipeError, ConnectionResetError):  # refused before all was sent: the answer is there
            connection.request("POST", path, body, {"Content-Type": KIND})
        return connection.getresponse().status
    finally:
        connection.close()


def encoded(picture: Image.Image) -> bytes:
    stream = BytesIO()
    picture.save(stream, "PNG")
    return stream.getvalue()


def grey_png(width: int, height: int) -> bytes:
    """A picture in red, green and blue with all its pixels, made row by row."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return pack(">I", len(content)) + kind + content + pack(">I", zlib.crc32(kind + content))

    squeezed = zlib.compressobj(1)
    rows = b"".join(squeezed.compress(b"\0" + bytes([128]) * (3 * width)) for _ in range(height)) + squeezed.flush()
    head = pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
