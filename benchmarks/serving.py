"""`python -m benchmarks.serving [MODEL]`: the memory of the process of `pavetwin serve`, and how soon it answers.

    python -m benchmarks.serving
    python -m benchmarks.serving mixed-3

One server gets all of it, one thing after the other, so that its greatest memory after each is what it took at most so
far. Linux only: memory is read from /proc.
"""

import argparse
import http.client
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from statistics import median
from time import perf_counter
from typing import Final

import numpy as np
from PIL import Image

from benchmarks.detecting import PICTURE
from benchmarks.process import peak_mib
from pavetwin.perception.shipped import DEFAULT

FRAME_PX: Final = (640, 480)
LARGE_PX: Final = (8640, 5776)
"""49.9 megapixels, just below what a server takes unless told."""

TIMEOUT_S: Final = 120


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.serving", description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", default=DEFAULT, help="a model, by file or name")
    asked = parser.parse_args(arguments)
    words = [sys.executable, "-m", "pavetwin", "serve", "--model", asked.model, "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"http://127\.0\.0\.1:(\d+)/", server.stdout.readline())
            if found is None:
                return 1
            measure(int(found[1]), server.pid, asked.model)
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait(TIMEOUT_S)
    return 0


def measure(port: int, process: int, model: str) -> None:
    """Send all of it, and print a row for each thing."""
    with Image.open(PICTURE) as held:
        street = held.convert("RGB")
    frame, large = jpeg(street.crop((0, 0, *FRAME_PX))), jpeg(tiled(street, LARGE_PX))
    print(f"{model}: what is sent | answers | greatest memory so far, MiB | seconds each, median")
    rows = (
        ("one frame of 640 × 480 px", 1, 1, frame),
        ("128 frames, from 32 clients", 128, 32, frame),
        ("8 uploads of 100 MB at a time", 8, 8, bytes(100_000_000)),
        ("16 uploads of 30 MB at a time", 16, 16, bytes(30_000_000)),
        ("an image of 49.9 megapixels", 1, 1, large),
        ("one frame again", 1, 1, frame),
    )
    for what, count, clients, content in rows:
        with ThreadPoolExecutor(clients) as senders:
            told = list(senders.map(lambda _, content=content: sent(port, content), range(count)))
        statuses = Counter(status for status, _ in told)
        answers = ", ".join(f"{number} × {status}" for status, number in sorted(statuses.items()))
        took_s = median(seconds for _, seconds in told)
        print(f"{what} | {answers} | {peak_mib(process):.0f} | {took_s:.2f}", flush=True)


def sent(port: int, content: bytes) -> tuple[int, float]:
    """The status of the answer to a file, and the seconds until it came."""
    head = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.jpg"\r\n\r\n'
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
    start = perf_counter()
    try:
        kind = {"Content-Type": "multipart/form-data; boundary=x"}
        connection.request("POST", "/predict", head + content + b"\r\n--x--\r\n", kind)
        return connection.getresponse().status, perf_counter() - start
    finally:
        connection.close()


def tiled(picture: Image.Image, size_px: tuple[int, int]) -> Image.Image:
    """The picture side by side until a size is full."""
    pixels = np.asarray(picture)
    down, across = -(-size_px[1] // pixels.shape[0]), -(-size_px[0] // pixels.shape[1])
    return Image.fromarray(np.tile(pixels, (down, across, 1))[: size_px[1], : size_px[0]])


def jpeg(picture: Image.Image) -> bytes:
    """As a file."""
    stream = BytesIO()
    picture.save(stream, "JPEG", quality=90)
    return stream.getvalue()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
