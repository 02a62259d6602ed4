"""Servers that are stopped."""

import asyncio

import pytest

from pavetwin import listening
from pavetwin.listening import close_all


class Stuck:
    """A server with a connection that never ends."""

    def __init__(self) -> None:
        self.is_stopped = False

    def stop(self) -> None:
        self.is_stopped = True

    async def close_all_connections(self) -> None:
        await asyncio.Event().wait()


def test_a_connection_that_does_not_end_holds_no_server_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "CLOSING_S", 0.02)
    server = Stuck()

    async def ended() -> None:
        await asyncio.wait_for(close_all(server), 10)  # type: ignore[arg-type]

    asyncio.run(ended())
    assert server.is_stopped
