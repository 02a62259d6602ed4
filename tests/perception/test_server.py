"""The server answers correctly or refuses with a 4xx, whatever it is sent, and goes on."""

import asyncio
import http.client
import json
import socket
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import display_name
from pavetwin.perception import server as server_module
from pavetwin.perception.detector import Detector
from pavetwin.perception.server import PredictionServer, ServerLimits
from scenes.drawn_detector import FILE, drawn

STREET = drawn((96, 64), ("pothole", (10, 8, 40, 48)), ("car", (60, 12, 90, 56)))
BOUNDARY = "x-boundary"


@dataclass(frozen=True)
class Running:
    server: PredictionServer
    port: int

    def ask(self, method: str, path: str, body: Any = None, kind: str = "") -> tuple[int, Any]:
        """Status, and the answer."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            with suppress(BrokenPipeError, ConnectionResetError):  # refused before all was sent: the answer is there
                connection.request(method, path, body, {"Content-Type": kind} if kind else {})
            answer = connection.getresponse()
            text = answer.read()
            return answer.status, json.loads(text) if "json" in answer.headers["Content-Type"] else text.decode()
        finally:
            connection.close()

    def send(self, *files: bytes, path: str = "/predict", field: str = "file") -> tuple[int, Any]:
        return self.ask("POST", path, form(*files, field=field), f"multipart/form-data; boundary={BOUNDARY}")


@contextmanager
def running(**limits: float) -> Iterator[Running]:
    server = PredictionServer(Detector(FILE, threads=1), "rectangles.onnx", ServerLimits(**limits))
    ports, ended = [], threading.Event()

    async def run() -> None:
        ports.append(server.start("127.0.0.1", 0))
        while not ended.is_set():
            await asyncio.sleep(0.01)
        await server.stop()

    thread = threading.Thread(target=asyncio.run, args=(run(),))
    thread.start()
    while not ports:
        time.sleep(0.005)
    try:
        yield Running(server, ports[0])
    finally:
        ended.set()
        thread.join()


@pytest.fixture(scope="module")
def service() -> Iterator[Running]:
    with running(upload_mb=1.0, megapixels=2.0, batch=3, timeout_s=1.0) as each:
        yield each


def form(*files: bytes, field: str = "file") -> bytes:
    parts = [
        f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{field}"; filename="{at}.jpg"\r\n'
        f"Content-Type: image/jpeg\r\n\r\n".encode()
        + content
        + b"\r\n"
        for at, content in enumerate(files)
    ]
    return b"".join(parts) + f"--{BOUNDARY}--\r\n".encode()


def encoded(picture: Image.Image, kind: str = "PNG") -> bytes:
    stream = BytesIO()
    picture.save(stream, kind)
    return stream.getvalue()


def png_of(width: int, height: int) -> bytes:
    """A picture that says to be of this size, with the pixels of none."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b""))


def wait_until(holds: Callable[[], bool]) -> None:
    until = time.monotonic() + 5
    while not holds() and time.monotonic() < until:
        time.sleep(0.01)
    assert holds()


def test_it_says_what_the_detector_says(service: Running) -> None:
    status, told = service.send(encoded(STREET))
    assert status == 200, told
    (found,) = Detector(FILE, threads=1).detect([STREET])
    assert (status, told["width"], told["height"]) == (200, 96, 64)
    assert [each["class"] for each in told["detections"]] == [*map(display_name, found.class_name)]
    np.testing.assert_allclose([each["box"] for each in told["detections"]], found.box_px, atol=0.01)
    np.testing.assert_allclose([each["confidence"] for each in told["detections"]], found.confidence, atol=1e-4)
    assert len(told["detections"][1]["outline"]) >= 4


def test_the_form_of_the_papers_server(service: Running) -> None:
    status, told = service.send(encoded(STREET, "JPEG"), path="/predict?format=rdmo")
    assert status == 200
    assert [set(each) for each in told] == [{"clase", "det_conf", "cls_conf", "caja"}] * 2
    assert told[1]["clase"] == "Pothole"
    assert told[1]["caja"] == pytest.approx([10, 8, 40, 48], abs=1)
    assert told[0]["cls_conf"] == 1.0


def test_a_batch_is_answered_in_its_order(service: Running) -> None:
    status, told = service.send(encoded(drawn((32, 32))), encoded(STREET), path="/predict/batch")
    assert status == 200
    assert [(each["name"], len(each["detections"])) for each in told] == [("0.jpg", 0), ("1.jpg", 2)]
    assert service.send(*[encoded(STREET)] * 4, path="/predict/batch")[0] == 400


def test_health_page_and_description(service: Running) -> None:
    status, told = service.ask("GET", "/health")
    assert (status, told["status"], told["model"], told["waiting"]) == (200, "ok", "rectangles.onnx", 0)
    status, document = service.ask("GET", "/openapi.json")
    assert (status, sorted(document["paths"])) == (200, ["/health", "/predict", "/predict/batch"])
    status, text = service.ask("GET", "/")
    assert status == 200
    assert all(path in text for path in document["paths"])


@pytest.mark.parametrize(
    ("content", "status", "words"),
    [
        (b"only text", 415, "is not an image in an accepted format"),
        (b"", 415, "is not an image in an accepted format"),
        (encoded(Image.effect_noise((64, 64), 50))[:-900], 400, "is damaged"),
        (encoded(drawn((2000, 1100))), 413, "has 2000 × 1100 px; at most 2 megapixels"),
        (png_of(20_000, 10_000), 413, "at most 2 megapixels"),
        (png_of(2_000_000, 2_000_000), 413, "megapixels"),
        (encoded(STREET, "GIF"), 415, "is not an image in an accepted format"),
    ],
    ids=["text", "empty", "truncated", "2.2 megapixels", "200 megapixels", "bomb", "gif"],
)
def test_what_is_no_image_of_the_limits_is_refused(service: Running, content: bytes, status: int, words: str) -> None:
    answered, told = service.send(content)
    assert (answered, words in told["error"]) == (status, True), told
    assert service.send(encoded(STREET))[0] == 200


def test_what_is_no_such_request_is_refused(service: Running) -> None:
    good = encoded(STREET)
    assert service.send(good, field="image")[0] == 400
    assert service.send(good, path="/predict?format=xml")[0] == 400
    assert service.send(good, good)[0] == 400
    assert service.ask("POST", "/predict", good, "image/png")[0] == 415
    assert service.ask("POST", "/predict", b"--x\r\nbroken", "multipart/form-data; boundary=x")[0] == 400
    assert service.ask("GET", "/predict")[0] == 405
    assert service.ask("GET", "/nothing")[0] == 404


def test_a_large_upload_is_refused_and_not_kept(service: Running) -> None:
    """100 MB against a limit of 1 MB, with its length told and in chunks of unknown number."""
    assert service.send(bytes(100_000_000))[0] == 413
    chunks = iter([form(bytes(700_000))] * 3)
    assert service.ask("POST", "/predict", chunks, f"multipart/form-data; boundary={BOUNDARY}")[0] == 413
    assert service.server.held == 0


def test_hung_clients_are_dropped_and_hold_nobody_up(service: Running) -> None:
    """One that sends no request, one that stops within its headers, one within its body."""
    hung = []
    head = f"POST /predict HTTP/1.1\r\nHost: here\r\nContent-Type: multipart/form-data; boundary={BOUNDARY}\r\n"
    for sent in (b"", head.encode(), f"{head}Content-Length: 5000\r\n\r\n--{BOUNDARY}".encode()):
        client = socket.create_connection(("127.0.0.1", service.port), timeout=10)
        client.sendall(sent)
        hung.append(client)
    assert service.send(encoded(STREET))[0] == 200
    for client in hung:
        assert client.recv(1000) == b""  # closed by the server
        client.close()
    wait_until(lambda: service.server.held == 0)


def test_32_clients_get_their_own_answers(service: Running) -> None:
    pictures = [drawn((96, 64), ("car", (20 + at, 12, 50 + at, 56))) for at in range(32)]
    with ThreadPoolExecutor(32) as clients:
        answers = list(clients.map(lambda picture: service.send(encoded(picture)), pictures))
    assert [status for status, _ in answers] == [200] * 32
    lefts = [told["detections"][0]["box"][0] for _, told in answers]
    assert lefts == pytest.approx([20 + at for at in range(32)], abs=0.5)


def test_requests_made_up_from_its_description_get_answers_of_its_description(service: Running) -> None:
    """By schemathesis: right and wrong parameters, forms and files, and good images in them."""
    schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed; `make setup` does it")
    schema = schemathesis.openapi.from_dict(service.ask("GET", "/openapi.json")[1])
    # The description cannot say that a file is an image, so what it allows is not always taken: images are, below.
    excluded = [schemathesis.checks.positive_data_acceptance]
    answered = set()

    @settings(max_examples=40)
    @given(data=st.data())
    def ask(data: st.DataObject) -> None:
        path = data.draw(st.sampled_from(["/predict", "/predict/batch", "/health"]))
        is_right = data.draw(st.booleans())
        fixed: dict[str, Any] = {}
        if path != "/health" and data.draw(st.booleans()):
            picture = encoded(STREET, data.draw(st.sampled_from(["PNG", "JPEG", "WEBP", "BMP", "TIFF"])))
            body = {"file": [picture] * 2 if "batch" in path else picture}
            fixed = {"body": body, "media_type": "multipart/form-data"}
        modes = schemathesis.GenerationMode
        operation = schema[path]["GET" if path == "/health" else "POST"]
        case = data.draw(operation.as_strategy(modes.POSITIVE if is_right else modes.NEGATIVE, **fixed))
        answer = case.call_and_validate(f"http://127.0.0.1:{service.port}", excluded_checks=excluded, timeout=20)
        assert answer.status_code == 200 or not (fixed and is_right)
        answered.add((path, answer.status_code))

    ask()
    assert {(path, 200) for path in schema} | {("/predict", 400), ("/predict", 415)} <= answered
    wait_until(lambda: service.server.held == 0)


def test_more_than_may_wait_is_told_to_come_again() -> None:
    with running(waiting=2) as service, ThreadPoolExecutor(12) as clients:
        look = service.server.detector.detect
        service.server.detector.detect = lambda *given: (time.sleep(0.1), look(*given))[1]  # type: ignore[method-assign]
        answers = list(clients.map(lambda _: service.send(encoded(STREET))[0], range(12)))
        assert set(answers) == {200, 429}
        assert service.send(encoded(STREET))[0] == 200


def test_who_hangs_up_holds_its_share_until_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its files wait for the detector's one thread: what they take is not free before."""
    closed, may_look = threading.Event(), threading.Event()
    hang_up = server_module._PredictHandler.on_connection_close
    monkeypatch.setattr(
        server_module._PredictHandler, "on_connection_close", lambda each: (hang_up(each), closed.set())[0]
    )
    large = encoded(STREET) + bytes(600_000)
    with running(upload_mb=1.0, held_mb=1.0) as service, ThreadPoolExecutor(1) as clients:
        look = service.server.detector.detect
        service.server.detector.detect = lambda *given: (may_look.wait(10), look(*given))[1]  # type: ignore[method-assign]
        first = clients.submit(service.send, encoded(STREET))
        wait_until(lambda: service.server.waiting == 1)
        body = form(large)
        head = f"Content-Type: multipart/form-data; boundary={BOUNDARY}\r\nContent-Length: {len(body)}\r\n"
        with socket.create_connection(("127.0.0.1", service.port), timeout=10) as gone:
            gone.sendall(f"POST /predict HTTP/1.1\r\nHost: here\r\n{head}\r\n".encode() + body)
            wait_until(lambda: service.server.waiting == 2)
        assert closed.wait(5)
        assert service.server.held >= 600_000
        assert service.send(large)[0] == 429
        may_look.set()
        assert first.result()[0] == 200
        wait_until(lambda: service.server.held == 0)
        assert service.send(large)[0] == 200


def test_one_request_may_be_as_large_as_it_is_told() -> None:
    """Also where that is more than all that wait may have by default."""
    large = encoded(STREET) + bytes(1_500_000)
    with running(upload_mb=2.0, held_mb=1.0) as service:
        assert service.send(large)[0] == 200
        assert service.send(large + bytes(1_000_000))[0] == 413


def test_an_image_may_have_as_many_pixels_as_it_is_told() -> None:
    """Pillow alone refuses what has more than 179 million."""
    with running(megapixels=300.0) as service:
        status, told = service.send(png_of(20_000, 10_000))
        assert (status, "is damaged" in told["error"]) == (400, True)
        status, told = service.send(png_of(20_000, 20_000))
        assert (status, "at most 300 megapixels" in told["error"]) == (413, True)


def test_what_takes_too_long_is_given_up() -> None:
    with running(look_s=0.3, megapixels=50.0) as service:
        before = time.monotonic()
        status, told = service.send(encoded(drawn((2400, 2400))))
        assert (status, "takes longer than 0.3 s" in told["error"]) == (413, True)
        assert time.monotonic() - before < 10
        assert service.send(encoded(drawn((32, 32))))[0] == 200


def test_an_address_in_use_is_told(service: Running) -> None:
    other = PredictionServer(service.server.detector, "m")
    with pytest.raises(PaveTwinError, match=rf"`port` {service.port}: it is in use at 127\.0\.0\.1"):
        other.start("127.0.0.1", service.port)
