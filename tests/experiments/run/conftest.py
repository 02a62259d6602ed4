"""A crossing with defects, and a study over it."""

from pathlib import Path

import pytest

from pavetwin.experiments.engine import Single
from pavetwin.experiments.run import run
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.studies import small


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "cross"
    save_world(damaged("cross", 6), folder)
    return folder


@pytest.fixture(scope="session")
def reference(world: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that nothing disturbed, flown by one process."""
    folder = tmp_path_factory.mktemp("reference") / "study"
    run(small(world), folder, Single())
    return folder
