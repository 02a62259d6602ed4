"""A crossing with defects, and a running page over it; a file with another world has fixtures of its own."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pavetwin.world.store import save_world
from scenes import damaged
from scenes.browser import NO_WEBGL, chromium
from scenes.page import RunningPage, running_page


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worlds") / "cross"
    save_world(damaged("cross", 8), folder)
    return folder


@pytest.fixture(scope="module")
def page(world: Path) -> Iterator[RunningPage]:
    with running_page([world]) as running:
        yield running


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Without WebGL: all but the town in 3-D works."""
    with chromium() as start:
        started = start(*NO_WEBGL)
        yield started
        started.close()
