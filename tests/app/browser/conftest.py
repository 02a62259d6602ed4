"""The page in Chromium, with WebGL and without."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scenes.browser import NO_WEBGL, BrowserTab, Launch, chromium, tab_of
from scenes.page import RunningPage, running_page


@pytest.fixture(scope="module")
def launch() -> Iterator[Launch]:
    with chromium() as start:
        yield start


@pytest.fixture(scope="module")
def browser(launch: Launch) -> Iterator[Any]:
    """Without WebGL: all but the town in 3-D works."""
    started = launch(*NO_WEBGL)
    yield started
    started.close()


@pytest.fixture(scope="module")
def server(world: Path) -> Iterator[RunningPage]:
    with running_page([world]) as running:
        yield running


@pytest.fixture
def tab(browser: Any, server: RunningPage) -> Iterator[BrowserTab]:
    """Closed with the proof that nothing went wrong, and that no other host was asked."""
    made = tab_of(browser, server)
    yield made
    made.page.close()
    assert made.errors == []
    assert made.hosts == {f"127.0.0.1:{server.port}"}
