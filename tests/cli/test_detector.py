"""`pavetwin detect` and `pavetwin serve`."""

import csv
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

import cv2
import numpy as np
import pytest
from benchmarks.process import peak_mib
from PIL import Image

from pavetwin.perception.detector import Detector
from scenes.aerial import HEIGHT_M, LATITUDE, LONGITUDE, aerial_photograph
from scenes.command_line import command, pavetwin, plain_refusal
from scenes.drawn_detector import FILE, drawn

STREET = drawn((640, 480), ("pothole", (100, 100, 160, 150)), ("car", (300, 200, 420, 330)))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a folder with an aerial photograph, a plain picture in a folder within, and a text file."""
    folder = tmp_path_factory.mktemp("detect")
    (folder / "in" / "sub").mkdir(parents=True)
    (folder / "in" / "a.jpg").write_bytes(aerial_photograph(STREET))
    drawn((96, 96), ("person", (30, 10, 60, 90))).save(folder / "in" / "sub" / "b.png")
    (folder / "in" / "c.jpg").write_text("text")
    done = pavetwin("detect", folder / "in", "--model", FILE, "-o", folder / "out")
    assert done.returncode == 0, done.stderr
    assert "2 images, 3 detections: Pothole 1, Person 1, Car 1." in done.stdout
    assert "Left out: 1 unreadable file" in done.stdout
    return folder / "out"


def test_every_form_holds_the_same_detections(found: Path) -> None:
    rows = list(csv.DictReader((found / "detections.csv").open()))
    assert [(row["image"], row["class"]) for row in rows] == [
        ("a.jpg", "Car"),
        ("a.jpg", "Pothole"),
        ("sub/b.png", "Person"),
    ]
    coco = json.loads((found / "coco.json").read_text())
    names = {kind["id"]: kind["name"] for kind in coco["categories"]}
    pothole = next(each for each in coco["annotations"] if names[each["category_id"]] == "Pothole")
    assert pothole["bbox"] == pytest.approx([100, 100, 60, 50], abs=0.5)
    printed = pothole["attributes"]
    assert printed["det_conf"] * printed["cls_conf"] == pytest.approx(pothole["score"], abs=1e-3)
    outline = np.array(pothole["segmentation"][0]).reshape(-1, 2)
    assert (outline.min(axis=0), outline.max(axis=0)) == (
        pytest.approx((100, 100), abs=1.1),
        pytest.approx((160, 150), abs=1.1),
    )
    task = json.loads((found / "label-studio.json").read_text())[0]
    value = task["predictions"][0]["result"][1]["value"]
    assert (value["x"], value["width"]) == pytest.approx((100 / 6.4, 60 / 6.4), abs=0.1)
    assert value["rectanglelabels"] == ["Pothole"]


def test_a_photograph_gives_sizes_and_places_on_the_ground(found: Path) -> None:
    """Straight down from 10 m, heading north: the pothole lies 190 px left of the middle and 115 px ahead of it."""
    gsd_m = HEIGHT_M * 13.2 / 8.8 / 640
    row = list(csv.DictReader((found / "detections.csv").open()))[1]
    assert float(row["area_m2"]) == pytest.approx(60 * 50 * gsd_m**2, rel=0.03)
    assert float(row["latitude"]) == pytest.approx(LATITUDE + 115 * gsd_m / 111_265, abs=1e-7)
    features = json.loads((found / "detections.geojson").read_text())["features"]
    assert [each["properties"]["image"] for each in features] == ["a.jpg", "a.jpg"]
    ring = np.array(features[1]["geometry"]["coordinates"][0])
    assert (ring[:, 0].max() < LONGITUDE, ring[:, 1].min() > LATITUDE) == (True, True)
    x, y = ring[:, 0], ring[:, 1]
    assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0  # counter-clockwise


def test_annotated_pictures_show_the_boxes(found: Path) -> None:
    with Image.open(found / "pictures" / "a-jpg.jpg") as shown:
        away = np.abs(np.asarray(shown, dtype=int) - np.asarray(STREET, dtype=int)).sum(axis=2) > 60
    assert away[100:151, 100:103].all(axis=0).any()
    assert not away[350:, :].any()
    assert (found / "pictures" / "sub" / "b-png.jpg").is_file()


def test_pictures_of_like_names_are_annotated_each(tmp_path: Path) -> None:
    for name in ("a.b.png", "a-b.png", "a.png", "a.jpg"):
        (tmp_path / "in").mkdir(exist_ok=True)
        drawn((96, 96)).save(tmp_path / "in" / name)
    done = pavetwin("detect", "in", "--model", FILE, "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    made = {path.name for path in (tmp_path / "out" / "pictures").iterdir()}
    assert made == {"a.b-png.jpg", "a-b-png.jpg", "a-png.jpg", "a-jpg.jpg"}


def test_a_video_is_looked_at_every_second(tmp_path: Path) -> None:
    film = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 5.0, (96, 96))
    for at in range(10):
        car = drawn((96, 96), ("car", (10 + at, 20, 50 + at, 70)))
        film.write(np.asarray(car)[:, :, ::-1].copy())
    film.release()
    done = pavetwin("detect", "v.avi", "--model", FILE, "-o", "out", "--no-pictures", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader((tmp_path / "out" / "detections.csv").open()))
    assert [(row["image"], row["class"]) for row in rows] == [("v-000000.jpg", "Car"), ("v-000005.jpg", "Car")]
    assert float(rows[1]["left"]) - float(rows[0]["left"]) == pytest.approx(5, abs=1)
    assert not (tmp_path / "out" / "pictures").exists()


def test_an_overview_is_asked_for(tmp_path: Path) -> None:
    STREET.save(tmp_path / "street.png")
    done = pavetwin("detect", "street.png", "--model", FILE, "-o", "out", "--overview", "--no-pictures", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader((tmp_path / "out" / "detections.csv").open()))
    expected, tiles = (
        Detector(FILE, **how, threads=1).detect([STREET])[0] for how in ({"overview": True}, {"tiled": True})
    )
    assert [float(row["confidence"]) for row in rows] == pytest.approx(expected.confidence.tolist(), abs=1e-3)
    assert expected.confidence.tolist() != tiles.confidence.tolist()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("in.png", "--model", FILE, "-o", "in.png", "--force"), "--output: 'in.png' is a file, so that nothing can"),
        (("in.png", "--model", FILE, "-o", "in.png/sub"), "into 'in.png/sub'; name a folder."),
        (("in.png", "-o", "new", "--model", "none-1"), "--model: There is no model 'none-1': name one that ships"),
        (("in.png", "--model", FILE), "Missing option '--output'"),
        (("gone", "--model", FILE, "-o", "new"), "There is no image, video or folder 'gone'"),
        (("empty", "--model", FILE, "-o", "new"), "There is no image in 'empty'"),
        (("text.jpg", "--model", FILE, "-o", "new"), "'text.jpg' cannot be read as an image"),
        (("text.mp4", "--model", FILE, "-o", "new"), "'text.mp4' cannot be read as a video"),
        (("in.png", "--model", "text.jpg", "-o", "new"), "'text.jpg' is damaged, or no ONNX model"),
        (("in.png", "--model", FILE, "-o", "new", "--gsd-mm", "0"), "--gsd-mm 0: it must be above 0"),
        (("in.png", "--model", FILE, "-o", "new", "--confidence", "25"), "--confidence 25: it must be above 0"),
        (("in.png", "--model", FILE, "-o", "new", "--image", "100"), "--image 100: a multiple of 32"),
        (("in.png", "--model", FILE, "-o", "new", "--whole", "--overview"), "--overview adds to the search in tiles"),
        (("in.png", "--model", FILE, "-o", "new", "--every", "-1"), "--every -1: it must be 0 or more"),
        (("in.png", "--model", FILE, "-o", "new", "--every", "nan"), "--every nan: it must be a finite number"),
        (("in.png", "--model", FILE, "-o", "new", "--gsd-mm", "nan"), "--gsd-mm nan: it must be a finite number"),
        (("in.png", "--model", FILE, "-o", "."), "--output '.' exists and is not empty"),
    ],
)
def test_detect_refuses_wrong_options_in_one_line(tmp_path: Path, arguments: tuple[object, ...], words: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.jpg").write_text("text")
    (tmp_path / "text.mp4").write_text("text")
    drawn((64, 64)).save(tmp_path / "in.png")
    assert words in plain_refusal(pavetwin("detect", *arguments, cwd=tmp_path))
    assert not (tmp_path / "new").exists()


def test_exporting_without_pytorch_names_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("torch", "torchvision", "onnx", "onnxscript"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "best.pt").write_text("text")
    line = plain_refusal(pavetwin("export", "best.pt", "-o", "m.onnx", cwd=tmp_path))
    assert "Exporting needs PyTorch" in line


def test_serve_listens_answers_and_ends() -> None:
    """The signal arrives while it answers, wherever in the loop that is."""
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
                reported = json.load(answer)
            assert (reported["model"], reported["overview"]) == ("rectangles.onnx", True)
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
        (("--model", FILE, "--max-mb", "0"), "--max-mb 0: it must be above 0"),
        (("--model", FILE, "--max-megapixels", "-1"), "--max-megapixels -1: it must be above 0"),
        (("--model", FILE, "--host", "256.0.0.1"), "--host 256.0.0.1: no listening there"),
    ],
)
def test_serve_refuses_wrong_options_in_one_line(tmp_path: Path, arguments: tuple[object, ...], words: str) -> None:
    assert words in plain_refusal(pavetwin("serve", *arguments, cwd=tmp_path))


def test_a_port_in_use_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert f"--port {port}: it is in use" in plain_refusal(pavetwin("serve", "--model", FILE, "--port", port))


KIND = "multipart/form-data; boundary=x"
LARGEST_MIB = 244
"""That all requests hold together by default, `ServerLimits.held_mb`."""


@pytest.mark.skipif(sys.platform != "linux", reason="the peak of a process's memory is read from /proc")
def test_the_memory_of_the_server_stays_bounded_under_bad_requests() -> None:
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
