"""The addresses under which the page is opened."""

import socket
from contextlib import suppress
from typing import Final

_ALL: Final = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}
"""What listens for every machine, and the name of this machine then."""

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
