"""Flights and drives by hand over a page's WebSocket."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scenes.page import RunningPage

Answer = Callable[[dict[str, Any]], dict[str, Any] | None]
"""The page's answer to a message about a flight; None for no answer."""


def steer(
    page: RunningPage, answer: Answer, request: dict[str, Any], do: str = "pilot"
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Messages about a flight or a drive by hand, and its end; the answer `{"do": "leave"}` closes the page."""

    async def fly() -> tuple[list[dict[str, Any]], dict[str, Any]]:
        client = await page.connect()
        task = {"id": 1, "do": do, "world": "w0", "request": request}
        await client.write_message(json.dumps(task))
        states: list[dict[str, Any]] = []
        while (message := await client.read_message()) is not None:
            told = json.loads(message)
            if {"done", "error", "cancelled"} & told.keys():
                client.close()
                return states, told
            if "live" in told:
                states.append(told["live"])
                if (said := answer(told["live"])) is not None:
                    if said["do"] == "leave":
                        break
                    await client.write_message(json.dumps({"id": 1, **said}))
        client.close()
        return states, {}

    return asyncio.run(fly())


def say(**stick: Any) -> dict[str, Any]:
    return {"do": "steer", "stick": stick}


def live_folders(page: RunningPage) -> list[Path]:
    return list(page.session.folder.glob("live*"))
