"""The HTTP server. It receives images concurrently and searches them one after the other."""

import asyncio
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from time import monotonic
from typing import Any, Final

from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPFile
from tornado.web import Application, HTTPError, RequestHandler, stream_request_body

from pavetwin._core import __version__
from pavetwin.listening import close_all, listening_sockets
from pavetwin.perception.detector import Detector
from pavetwin.perception.openapi import description, page
from pavetwin.perception.results import REPLIES, DetectedImage, described
from pavetwin.perception.uploads import RefusedRequestError, ServerLimits, decoded, files_of

MEGABYTE: Final = 1_000_000

_LARGEST_DISCARDED: Final = 1 << 30
"""Most bytes of a refused body that are read and dropped, so that the client can read the answer."""

_BUSY: Final = "The server is busy; try again in a second."

_BUFFER: Final = 1 << 20
"""Buffer of a connection, in bytes."""


class PredictionServer:
    """A detector with its queue of requests and their limits."""

    def __init__(self, detector: Detector, model: str, limits: ServerLimits | None = None) -> None:
        """Args:
        model: name shown by `/health`.
        """
        self.detector, self.model = detector, model
        self.limits = limits or ServerLimits()
        self.held = 0
        """Bytes of request bodies that are being received or wait."""
        self.waiting = 0
        """Requests that wait for the detector or are being processed."""
        self._started_s = monotonic()
        self._worker = ThreadPoolExecutor(1, "detector")
        self._http: HTTPServer | None = None
        self._is_stopped = False

    def start(self, host: str, port: int) -> int:
        """Listen, within a running event loop.

        Args:
            port: 0 takes a free one.

        Returns:
            The port.

        Raises:
            PaveTwinError: the address is in use, or not of this machine.
        """
        sockets, bound = listening_sockets(host, port)
        handlers = [
            (r"/", _PageHandler),
            (r"/openapi.json", _DocumentHandler),
            (r"/health", _HealthHandler),
            (r"/predict", _OneHandler),
            (r"/predict/batch", _BatchHandler),
        ]
        application = Application(
            [(path, handler, {"server": self}) for path, handler in handlers],
            default_handler_class=_UnknownHandler,
            default_handler_args={"server": self},
            log_function=lambda handler: None,  # noqa: ARG005
        )
        self._http = HTTPServer(
            application,
            max_body_size=_LARGEST_DISCARDED,
            max_buffer_size=_BUFFER,
            body_timeout=self.limits.timeout_s,
            idle_connection_timeout=self.limits.timeout_s,
        )
        self._http.add_sockets(sockets)
        return bound

    async def stop(self) -> None:
        """Stop listening, close all connections, and end the detector's work after its current tiles."""
        self._is_stopped = True
        if self._http is not None:
            await close_all(self._http)
        self._worker.shutdown(wait=False, cancel_futures=True)

    @property
    def health(self) -> dict[str, Any]:
        facts = self.detector.facts
        return {
            "status": "ok",
            "version": __version__,
            "model": self.model,
            "classes": list(facts.classes),
            "image_px": self.detector.image_px,
            "tiled": self.detector.tiled,
            "overview": self.detector.overview,
            "waiting": self.waiting,
            "uptime_s": round(monotonic() - self._started_s, 1),
        }

    async def detect(self, files: list[HTTPFile], is_gone: Callable[[], bool]) -> list[DetectedImage]:
        """The detections of files, from the detector's only thread.

        Args:
            is_gone: returns whether the client has disconnected.
        """
        return await asyncio.get_running_loop().run_in_executor(self._worker, self._detect, files, is_gone)

    def _detect(self, files: list[HTTPFile], is_gone: Callable[[], bool]) -> list[DetectedImage]:
        until_s = monotonic() + self.limits.look_s

        def check(_done: float = 0.0) -> None:
            if is_gone() or self._is_stopped:
                raise RefusedRequestError(400, "The client has disconnected.")
            if monotonic() > until_s:
                message = f"The search takes longer than {self.limits.look_s:g} s; send fewer or smaller images."
                raise RefusedRequestError(413, message)

        done = []
        for file in files:
            check()
            pixels, pose = decoded(file, self.limits.megapixels)
            (found,) = self.detector.detect([pixels], check)
            done.append(described(file["filename"], found, pose))
        return done


@stream_request_body
class _AnyHandler(RequestHandler):
    """Base of all handlers: errors as JSON; request bodies are dropped."""

    allowed = "GET"
    """The accepted method."""

    def initialize(self, server: PredictionServer) -> None:
        self.server = server

    def set_default_headers(self) -> None:
        self.set_header("Server", "PaveTwin")
        self.set_header("X-Content-Type-Options", "nosniff")

    def data_received(self, chunk: bytes) -> None:
        """Nothing is kept."""

    def write_error(self, status_code: int, **how: Any) -> None:
        error = how.get("exc_info", (None, None, None))[1]
        message = str(error) if isinstance(error, RefusedRequestError) else f"{self._reason}."
        if status_code == 405:
            self.set_header("Allow", self.allowed)
        self.reply({"error": message})

    def reply(self, content: Any) -> None:
        """Answer with JSON."""
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.finish(json.dumps(content, ensure_ascii=False))


class _UnknownHandler(_AnyHandler):
    def _refuse(self) -> None:
        raise HTTPError(404)

    get = head = post = put = patch = delete = options = _refuse


class _HealthHandler(_AnyHandler):
    def get(self) -> None:
        self.reply(self.server.health)


class _DocumentHandler(_AnyHandler):
    def get(self) -> None:
        self.reply(description(__version__, self.server.limits))


class _PageHandler(_AnyHandler):
    def get(self) -> None:
        self.finish(page(description(__version__, self.server.limits)))


class _PredictHandler(_AnyHandler):
    allowed = "POST"
    most = 1
    """Most files of a request."""

    def initialize(self, server: PredictionServer) -> None:
        super().initialize(server)
        self._body = bytearray()
        self._held, self._is_gone, self._is_handed_over = 0, False, False
        self._refusal: RefusedRequestError | None = None

    async def prepare(self) -> None:
        length = self.request.headers.get("Content-Length", "0")
        if self.request.method == "POST" and length.isdecimal():
            self._check_length(int(length))

    def data_received(self, chunk: bytes) -> None:
        self._check_length(len(self._body) + len(chunk))
        if self._refusal is None:
            self._body += chunk
            self._held += len(chunk)
            self.server.held += len(chunk)

    def _check_length(self, length: int) -> None:
        """Discard a body that is too long. The rest is read and dropped before the answer, since a client that is still
        sending does not read."""
        limits = self.server.limits
        if self._refusal is not None:
            return
        if length > limits.upload_mb * MEGABYTE:
            self._refusal = RefusedRequestError(413, f"The request is larger than {limits.upload_mb:g} MB.")
        elif self.server.held - self._held + length > max(limits.held_mb, limits.upload_mb) * MEGABYTE:
            self._refusal = RefusedRequestError(429, _BUSY)
        if self._refusal is not None:
            self._release()

    async def post(self) -> None:
        if self._refusal is not None:
            raise self._refusal
        asked = self.get_query_argument("format", next(iter(REPLIES)))
        if asked not in REPLIES:
            raise RefusedRequestError(400, f"No format '{asked[:40]}'; known are {', '.join(REPLIES)}.")
        if self.server.waiting >= self.server.limits.waiting:
            raise RefusedRequestError(429, _BUSY)
        body, self._body = bytes(self._body), bytearray()
        files = files_of(self.request.headers.get("Content-Type", ""), body, self.most)
        del body
        self.server.waiting += 1
        self._is_handed_over = True
        try:
            found = await self.server.detect(files, lambda: self._is_gone)
        finally:
            self.server.waiting -= 1
            self._is_handed_over = False
            self._release()
        if not self._is_gone:
            self.answer([REPLIES[asked](image) for image in found])

    def answer(self, images: list[Any]) -> None:
        """Send the replies for all images."""
        self.reply(images[0])

    def send_error(self, status_code: int = 500, **how: Any) -> None:
        error = how.get("exc_info", (None, None, None))[1]
        super().send_error(error.status if isinstance(error, RefusedRequestError) else status_code, **how)

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        if not isinstance(error, RefusedRequestError):
            super().log_exception(kind, error, trace)

    def on_connection_close(self) -> None:
        self._is_gone = True
        # Files that wait for the detector keep their memory until it has run.
        if not self._is_handed_over:
            self._release()

    def on_finish(self) -> None:
        self._release()

    def _release(self) -> None:
        self.server.held -= self._held
        self._held = 0
        self._body = bytearray()


class _OneHandler(_PredictHandler):
    pass


class _BatchHandler(_PredictHandler):
    def initialize(self, server: PredictionServer) -> None:
        super().initialize(server)
        self.most = server.limits.batch

    def answer(self, images: list[Any]) -> None:
        self.reply(images)


async def serve_forever(server: PredictionServer, host: str, port: int, report: Callable[[int], None]) -> None:
    """Run until the task is cancelled.

    Args:
        report: called with the port once the server listens.
    """
    report(server.start(host, port))
    try:
        await asyncio.Event().wait()
    finally:
        await server.stop()
