"""A crossing with defects, over which a mission was flown once."""

from pathlib import Path

import pytest

from pavetwin.world.store import save_world
from scenes import damaged
from scenes.command_line import SHORT, pavetwin


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fly") / "cross"
    save_world(damaged("cross", 8), folder)
    done = pavetwin("fly", folder, *SHORT, "-o", folder.parent / "warm")
    assert done.returncode == 0, done.stderr
    return folder
