"""Who is answered: only who has the token, under the address that the command printed, from no other site's page."""

import hmac
import secrets
import socket
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
        """Whether a request is from this server's own page, or from no page at all."""
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
