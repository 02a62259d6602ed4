"""Access to the page: host names, the token, and the page for browsers that are refused."""

import hmac
import secrets
import socket
from base64 import b64encode
from contextlib import suppress
from hashlib import sha256
from html import escape
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

COOKIE: Final = "pavetwin"

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self' ws://{host}",
        "frame-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""Content-Security-Policy of what is answered; `{host}` as the browser names this server."""


REPORT_POLICY: Final = "; ".join(
    (
        "sandbox",
        "default-src 'none'",
        "style-src 'unsafe-inline'",
        "img-src data:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'self'",
    )
)
"""Content-Security-Policy of a report, which the page shows in a frame."""

REFUSING: Final = "default-src 'none'; frame-ancestors 'none'"
"""Content-Security-Policy of what is refused."""


class Guard:
    """Checks requests. The token is in the address that the command prints; the browser keeps it as a cookie."""

    def __init__(self, host: str) -> None:
        """Args:
        host: where the server listens.
        """
        self.token = secrets.token_urlsafe(24)
        self._names = {"localhost", socket.gethostname().lower(), host.lower()}

    def is_token(self, text: str | None) -> bool:
        """In a time that does not depend on how much of it is right."""
        return text is not None and hmac.compare_digest(text.encode(), self.token.encode())

    def is_host(self, host: str, port: int) -> bool:
        """Whether a `Host` names this server: its port, with an address or a name of this machine. A name that a
        foreign site has made point here (DNS rebinding) is none of these."""
        try:
            parts = urlsplit(f"//{host}")
            name, named_port = (parts.hostname or "").lower(), parts.port or 80
        except ValueError:
            return False
        is_plain = not (parts.username or parts.path or parts.query or parts.fragment)
        return is_plain and named_port == port and (name in self._names or _is_address(name))

    @staticmethod
    def is_origin(origin: str | None, host: str) -> bool:
        """Whether a request comes from this server's own page, or from no page."""
        return origin is None or origin.lower() == f"http://{host}".lower()

    @staticmethod
    def policy(host: str) -> str:
        """The Content-Security-Policy for a `Host` that was checked."""
        return POLICY.format(host=host)


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


_ALL: Final = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}
"""Addresses that accept every machine, with the name to open on this one."""

_ELSEWHERE: Final = ("192.0.2.1", 9)
"""An address for examples (RFC 5737): nothing is sent to it."""


def own_name(host: str) -> str:
    """How this machine names a server that listens at `host`, as in an address."""
    return _ALL.get(host) or (f"[{host}]" if ":" in host else host)


def name_for_others(host: str) -> str | None:
    """How other machines name it: by the address from which this machine reaches others, or by its name; None where
    only `host` itself is listened at."""
    if host not in _ALL:
        return None
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(_ELSEWHERE)  # chooses a way, and sends nothing
        return str(probe.getsockname()[0])
    return socket.gethostname()


_STYLE: Final = (
    ":root{color-scheme:light dark}"
    "body{margin:18vh auto 0;max-width:34rem;padding:0 1.5rem;background:#f4f1eb;color:#23211e;"
    "font:16px/1.5 system-ui,'DejaVu Sans',sans-serif}"
    "h1{font-size:1.3rem;margin:0 0 .6rem}p{margin:0 0 .6rem}"
    "code{padding:1px 5px;border-radius:4px;background:#e5e1d9}"
    "@media(prefers-color-scheme:dark){body{background:#141618;color:#ebe8e3}code{background:#2e3135}}"
)

REFUSAL_POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        f"style-src 'sha256-{b64encode(sha256(_STYLE.encode()).digest()).decode()}'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""Its Content-Security-Policy: this one style, and nothing else."""


def refusal_page(words: str) -> str:
    """HTML page with the reason and the fix.

    Args:
        words: plain text.
    """
    return f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>PaveTwin</title>
<style>{_STYLE}</style>
<main>
<h1>This page opens from its address</h1>
<p>{escape(words)}</p>
<p>It is in the terminal, in the line “The page is at …”. The token in it lets you in, and this browser keeps it.</p>
<p>Each start has a new token: where <code>pavetwin app</code> was started again, open the new address.</p>
</main>
</html>
"""
