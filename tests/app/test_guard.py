"""Who is answered: every request without the token, under another address or from another page is refused."""

import asyncio
import base64
import hashlib
import http.client
import re
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from tornado.httpclient import HTTPClientError

from pavetwin.app.guard import COOKIE, Guard, name_for_others, own_name, refusal_page
from pavetwin.app.handlers import STATIC
from scenes.page import RunningPage, running_page

ADDRESSES = (
    "/api/start",
    "/api/worlds/w0/map",
    "/api/played/x/flight.json.gz",
    "/town/w0/manifest.json",
    "/static/main.js",
    "/nothing",
    "/live",
)


@pytest.fixture(scope="module")
def page() -> Iterator[RunningPage]:
    with running_page([]) as running:
        yield running


def test_the_printed_address_gives_a_cookie_and_the_page(page: RunningPage) -> None:
    answer = page.get(f"/?token={page.guard.token}", Cookie="")
    assert answer.status == 200
    assert answer.body == (STATIC / "index.html").read_bytes()
    cookie = answer.headers["Set-Cookie"]
    assert cookie.startswith(f"{COOKIE}-{page.port}={page.guard.token};")
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert page.get("/").status == 200, "a page that is loaded again has its cookie"


@pytest.mark.parametrize("path", ADDRESSES)
@pytest.mark.parametrize(
    "cookie", ["", "pavetwin=x", "pavetwin-{port}=", "pavetwin-{port}=ä", "pavetwin-{port}={token}x"]
)
def test_without_the_token_nothing_is_answered(page: RunningPage, path: str, cookie: str) -> None:
    value = cookie.format(port=page.port, token=page.guard.token)
    answer = page.get(path, Cookie=value.encode().decode("latin-1"))
    assert answer.status == 403
    assert page.guard.token.encode() not in answer.body


def test_a_wrong_token_opens_no_page(page: RunningPage) -> None:
    for query in ("", "?token=", "?token=x", f"?token={page.guard.token[:-1]}"):
        assert page.get(f"/{query}", Cookie="").status == 403


BROWSER = {"Cookie": "", "Accept": "text/html,application/xhtml+xml,*/*;q=0.8"}


def test_a_browser_without_the_token_gets_a_hint(page: RunningPage) -> None:
    for path, host in (("/", ""), ("/?token=x", ""), ("/", f"evil.example:{page.port}")):
        answer = page.get(path, **BROWSER, **({"Host": host} if host else {}))
        assert answer.status == (421 if host else 403)
        assert answer.headers["Content-Type"].startswith("text/html")
        text = answer.body.decode()
        assert "open the address that the command printed" in text or "open the one that the command printed" in text
        assert page.guard.token not in text
        assert not re.search("src=|href=|url\\(|<script", text), "it asks for nothing"
        (style,) = re.findall("<style>(.*)</style>", text)
        assert "color-scheme:light dark" in style
        hashed = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
        rules = dict(rule.strip().split(" ", 1) for rule in answer.headers["Content-Security-Policy"].split(";"))
        assert rules["default-src"] == "'none'"
        assert rules["style-src"] == f"'sha256-{hashed}'"
        assert rules["frame-ancestors"] == "'none'"


def test_other_addresses_and_other_clients_get_no_such_page(page: RunningPage) -> None:
    for path in ADDRESSES:
        assert b"opens from its address" not in page.get(path, **BROWSER).body
    assert page.get("/api/start", **BROWSER).values["error"]
    assert page.get("/nothing", Accept="text/html").values["error"]
    assert page.get("/", Cookie="").values["error"]


def test_a_refusal_shows_no_markup_of_others() -> None:
    assert "<b>" not in refusal_page("<b>")


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_other_machines_get_an_address_that_is_answered(host: str) -> None:
    name = name_for_others(host)
    assert name is not None
    assert not name.startswith("127.")
    assert Guard(host).is_host(f"{name}:8765", 8765)
    assert Guard(host).is_host(f"{own_name(host)}:8765", 8765)


def test_a_machine_without_a_way_to_others_is_named_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError

    monkeypatch.setattr(socket.socket, "connect", fail)
    name = name_for_others("0.0.0.0")
    assert name == socket.gethostname()
    assert Guard("0.0.0.0").is_host(f"{name}:1", 1)


def test_where_one_address_is_listened_at_there_is_no_other() -> None:
    assert [name_for_others(host) for host in ("127.0.0.1", "localhost", "::1", "192.168.1.5")] == [None] * 4
    assert [own_name(host) for host in ("::1", "box")] == ["[::1]", "box"]


@pytest.mark.parametrize("path", ["/", *ADDRESSES])
@pytest.mark.parametrize(
    "host",
    ["evil.example:{port}", "localhost.evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "a@127.0.0.1:{port}", ""],
)
def test_another_host_is_refused(page: RunningPage, path: str, host: str) -> None:
    assert page.get(path, Host=host.format(port=page.port)).status in (400, 421)


@pytest.mark.parametrize("path", ["/", *ADDRESSES])
@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://localhost:{port}"],
)
def test_another_origin_is_refused(page: RunningPage, path: str, origin: str) -> None:
    assert page.get(path, Origin=origin.format(port=page.port)).status == 403


def test_its_own_origin_is_answered(page: RunningPage) -> None:
    for host in (f"127.0.0.1:{page.port}", f"localhost:{page.port}", f"[::1]:{page.port}"):
        assert page.get("/static/main.js", Host=host, Origin=f"http://{host}").status == 200


@pytest.mark.parametrize("header", [{"Origin": "http://evil.example"}, {"Host": "evil.example"}, {"Cookie": "a=b"}])
def test_a_foreign_websocket_is_refused(page: RunningPage, header: dict[str, str]) -> None:
    with pytest.raises(HTTPClientError, match=r"403|421"):
        asyncio.run(page.connect(**header))


@pytest.mark.parametrize(
    "path",
    [
        "/static/../guard.py",
        "/static/%2e%2e/guard.py",
        "/static/..%2fguard.py",
        "/static//etc/passwd",
        "/static/",
        "/api/played/../../../etc/passwd",
        "/api/played/x/files/..%2f..%2fetc%2fpasswd",
        "/api/worlds/..%2f..%2f/map",
        "/api/worlds/w0/map",
    ],
)
def test_no_path_leads_out(page: RunningPage, path: str) -> None:
    answer = page.get(path)
    assert answer.status in (403, 404)
    assert b"root:" not in answer.body
    assert b"import " not in answer.body


def test_every_answer_forbids_other_hosts_scripts_and_frames(page: RunningPage) -> None:
    policy = page.get("/").headers["Content-Security-Policy"]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == "'self'"
    assert rules["style-src"] == "'self'"
    assert rules["connect-src"] == f"'self' ws://127.0.0.1:{page.port}"
    assert rules["frame-ancestors"] == "'none'"
    refused = page.get("/nothing").headers
    assert refused["X-Content-Type-Options"] == "nosniff"
    assert "frame-ancestors 'none'" in refused["Content-Security-Policy"]


def test_only_loopback_listens(page: RunningPage) -> None:
    """As `ss --listening` lists it, of both versions of IP."""
    tables = [Path("/proc/net", name) for name in ("tcp", "tcp6")]
    listed = [line.split() for table in tables if table.exists() for line in table.read_text().splitlines()[1:]]
    ours = [
        row[1].partition(":")[0] for row in listed if row[3] == "0A" and int(row[1].partition(":")[2], 16) == page.port
    ]
    assert ours == [socket.inet_aton("127.0.0.1")[::-1].hex().upper()]


def test_a_large_body_is_refused_and_the_server_goes_on(page: RunningPage) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=20)
    try:
        connection.request("POST", "/api/start", b"x" * 1_000_000, page.cookie)
        assert connection.getresponse().status in (400, 405, 413)
    except OSError:
        pass  # it may close before all is sent
    finally:
        connection.close()
    assert page.get("/").status == 200


def test_the_page_and_its_parts_name_no_other_host() -> None:
    for path in STATIC.glob("*.*"):
        text = path.read_text(encoding="utf-8")
        if not path.name.startswith("vendor"):
            assert set(re.findall(r"https?://[\w.]+", text)) <= {"http://www.w3.org"}, path  # the namespace of SVG


def test_tokens_differ() -> None:
    assert Guard("127.0.0.1").token != Guard("127.0.0.1").token
