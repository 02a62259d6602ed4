"""HTTP handlers: the page and its files, worlds, played missions, and results to download."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from tornado.http1connection import HTTP1Connection
from tornado.iostream import StreamClosedError
from tornado.web import HTTPError, RequestHandler, StaticFileHandler, stream_request_body

from pavetwin._core import __version__
from pavetwin.app.guard import COOKIE, REFUSAL_POLICY, REFUSING, REPORT_POLICY, Guard, refusal_page
from pavetwin.app.requests import check_size
from pavetwin.app.session import Session
from pavetwin.app.uploads import SENDING_S, Upload
from pavetwin.errors import PaveTwinError

STATIC: Final = Path(__file__).parent / "static"

_BLOCK: Final = 1 << 16
"""Bytes of a file that are sent before the client has to read them."""


class RefusedError(HTTPError):
    """A request that is answered with one plain line."""

    def __init__(self, status: int, words: str) -> None:
        super().__init__(status)
        self.words = words


class GuardedHandler(RequestHandler):
    """Handler that answers authorised requests only, see `Guard`. Errors are JSON with a one-line message."""

    needs_token = True

    def initialize(self, session: Session, guard: Guard) -> None:
        self.session, self.guard = session, guard

    def set_default_headers(self) -> None:
        self.set_header("Server", "PaveTwin")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cross-Origin-Opener-Policy", "same-origin")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Security-Policy", REFUSING)

    def prepare(self) -> None:
        check_request(self)
        self.set_header("Content-Security-Policy", self.guard.policy(self.request.host))

    def reply(self, content: Any) -> None:
        """Answer with JSON."""
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.finish(json.dumps(content))

    def write_error(self, status_code: int, **how: Any) -> None:  # noqa: ARG002 - Tornado's
        error = how.get("exc_info", (None, None, None))[1]
        words = error.words if isinstance(error, RefusedError) else f"{self._reason}."
        self.reply({"error": words})

    async def send_file(self, path: Path, kind: str, *, gzipped: bool = False, name: str | None = None) -> None:
        """Send a file in blocks, each once the client has taken the one before.

        Args:
            kind: its content type.
            gzipped: it is stored compressed, and the browser is to unpack it.
            name: under which the browser is to save it.
        """
        self.set_header("Content-Type", kind)
        if gzipped:
            self.set_header("Content-Encoding", "gzip")
        if name is not None:
            self.set_header("Content-Disposition", f"attachment; filename*=UTF-8''{quote(name, safe='')}")
        with path.open("rb") as file, suppress(StreamClosedError):  # a client that goes away needs nothing more
            while block := file.read(_BLOCK):
                self.write(block)
                await self.flush()
            await self.finish()


def check_request(handler: Any) -> None:
    """Raises:
    RefusedError: 403 or 421, where the request is not from who may ask.
    """
    request, guard = handler.request, handler.guard
    port = handler.application.settings["bound_port"]
    if not guard.is_host(request.headers.get("Host", ""), port):
        raise RefusedError(421, "This address is not the server's own; open the one that the command printed.")
    if not guard.is_origin(request.headers.get("Origin"), request.host):
        raise RefusedError(403, "Pages of other sites are not answered.")
    if handler.needs_token and not guard.is_token(handler.get_cookie(f"{COOKIE}-{port}")):
        raise RefusedError(403, "The token is missing; open the address that the command printed.")


class PageHandler(GuardedHandler):
    """The page itself. Its address has the token, which becomes a cookie."""

    needs_token = False

    async def get(self) -> None:
        port = self.application.settings["bound_port"]
        given = self.get_query_argument("token", None)
        if not self.guard.is_token(given) and not self.guard.is_token(self.get_cookie(f"{COOKIE}-{port}")):
            raise RefusedError(403, "The token is missing; open the address that the command printed.")
        if given is not None:
            self.set_cookie(f"{COOKIE}-{port}", self.guard.token, httponly=True, samesite="Strict", path="/")
        await self.send_file(STATIC / "index.html", "text/html; charset=utf-8")

    def write_error(self, status_code: int, **how: Any) -> None:
        """Send browsers a page with the fix."""
        error = how.get("exc_info", (None, None, None))[1]
        if not isinstance(error, RefusedError) or "text/html" not in self.request.headers.get("Accept", ""):
            super().write_error(status_code, **how)
            return
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Content-Security-Policy", REFUSAL_POLICY)
        self.finish(refusal_page(error.words))


class FileHandler(StaticFileHandler):
    """The page's own scripts and styles."""

    needs_token = True

    def initialize(self, session: Session, guard: Guard, path: str) -> None:  # type: ignore[override]
        self.session, self.guard = session, guard
        super().initialize(path)

    def prepare(self) -> None:
        check_request(self)

    def set_default_headers(self) -> None:
        self.set_header("Server", "PaveTwin")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-cache")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")


class StartHandler(GuardedHandler):
    """First data of the page: the worlds, and the choices for a mission."""

    async def get(self) -> None:
        try:
            choices = await self.session.choices()
        except PaveTwinError as error:
            raise RefusedError(500, str(error)) from error
        self.reply(
            {
                "version": __version__,
                "worlds": [{"id": world.id, "name": world.name} for world in self.session.worlds],
                "exhibits": [
                    {"id": each.id, "name": each.folder.name, "kind": each.kind.value} for each in self.session.exhibits
                ],
                **choices,
            }
        )


class MapHandler(GuardedHandler):
    async def get(self, world: str) -> None:
        try:
            file = await self.session.map_file(world)
        except PaveTwinError as error:
            raise RefusedError(404, str(error)) from error
        await self.send_file(file, "application/json; charset=utf-8", gzipped=True)


class TownHandler(GuardedHandler):
    """A file of a town in 3-D, by its name in the town's manifest."""

    async def get(self, world: str, name: str) -> None:
        try:
            file = await self.session.town_file(world, name)
        except PaveTwinError as error:
            raise RefusedError(404, str(error)) from error
        if file is None:
            raise RefusedError(404, "The town has no file of that name.")
        if file.tag is not None:
            self.set_header("Cache-Control", "private, no-cache")
            self.set_header("ETag", f'"{file.tag}"')
            if self.check_etag_header():
                self.set_status(304)
                return
        kind = "application/json; charset=utf-8" if file.path.suffix == ".json" else "application/octet-stream"
        await self.send_file(file.path, kind)


class PlayedHandler(GuardedHandler):
    """The files that play a mission; a mission's key names what it is, so that they never change."""

    kinds: Final = {".json.gz": "application/json; charset=utf-8", ".bin.gz": "application/octet-stream"}

    async def get(self, key: str, name: str) -> None:
        played = self.session.played(key)
        path = None if played is None else played.folder / name
        kind = next((kind for end, kind in self.kinds.items() if name.endswith(end)), None)
        if path is None or kind is None or not path.is_file():
            raise RefusedError(404, "This mission no longer exists; fly it again.")
        self.set_header("Cache-Control", "private, max-age=86400, immutable")
        await self.send_file(path, kind, gzipped=True)


class ExhibitHandler(GuardedHandler):
    """Report of a study or contact sheet of a dataset. A report embeds its styles and images, and has no script."""

    async def get(self, key: str, name: str) -> None:
        file = self.session.shown_file(key, name)
        if file is None:
            raise RefusedError(404, "This report no longer exists; choose it again.")
        self.set_header("Content-Security-Policy", REPORT_POLICY)
        await self.send_file(file, "text/html; charset=utf-8" if name.endswith(".html") else "image/jpeg")


class ResultHandler(GuardedHandler):
    """A file of a mission's results, as the command line wrote it."""

    async def get(self, key: str, name: str) -> None:
        played = self.session.played(key)
        if played is None or name not in played.names or not (played.results / name).is_file():
            raise RefusedError(404, "There is no such file.")
        kind = "image/png" if name.endswith(".png") else "application/octet-stream"
        shown = None if kind == "image/png" and self.get_query_argument("show", "") else name.replace("/", "-")
        await self.send_file(played.results / name, kind, name=shown)


class MadeHandler(GuardedHandler):
    """A file made from a mission on request."""

    async def get(self, key: str, name: str) -> None:
        file = self.session.made_file(key, name)
        if file is None:
            raise RefusedError(404, "There is no such file.")
        await self.send_file(file, "application/octet-stream", name=name.replace("/", "-"))


@stream_request_body
class UploadHandler(GuardedHandler):
    """A map that a page has announced, block by block as it comes."""

    _upload: Upload | None = None

    def prepare(self) -> None:
        super().prepare()
        size = self.request.headers.get("Content-Length", "")
        if self.request.method != "POST":
            raise RefusedError(405, "A map is sent by POST.")
        if not (size.isascii() and size.isdigit()) or len(size) > 20:
            raise RefusedError(411, "A map is sent with its length.")
        try:
            check_size(int(size))
        except PaveTwinError as error:
            raise RefusedError(413, str(error)) from error
        try:
            self._upload = self.session.uploads.begin(self.path_args[0], int(size))
        except PaveTwinError as error:
            raise RefusedError(404, str(error)) from error
        assert isinstance(self.request.connection, HTTP1Connection)
        self.request.connection.set_max_body_size(int(size))
        self.request.connection.set_body_timeout(SENDING_S)

    def data_received(self, chunk: bytes) -> None:
        assert self._upload is not None
        try:
            self._upload.take(chunk)
        except PaveTwinError as error:
            self.set_status(410)
            self.reply({"error": str(error)})  # which ends the connection

    def post(self, key: str) -> None:  # noqa: ARG002 - `prepare` has used it
        assert self._upload is not None
        if self._finished:  # it was refused with the last block
            return
        self._upload.end()
        self.set_status(204)
        self.finish()

    def on_connection_close(self) -> None:
        if self._upload is not None:
            self._upload.fail()


class UnknownHandler(GuardedHandler):
    def prepare(self) -> None:
        super().prepare()
        raise RefusedError(404, "There is no such page.")
