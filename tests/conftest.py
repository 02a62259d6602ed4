"""Hypothesis profiles, the cache, and real input for all tests."""

import gc
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from pavetwin.errors import PaveTwinError
from pavetwin.render.adapter import find_adapter

ROOT = Path(__file__).resolve().parent.parent

# The same few examples in every run: a red build is the change's doing. `make test-all` draws more and new ones, to
# find what these do not show (`--hypothesis-profile explore`).
settings.register_profile("explore", deadline=None, print_blob=True)
settings.register_profile(
    "repeatable", parent=settings.get_profile("explore"), derandomize=True, database=None, max_examples=20
)
settings.load_profile("repeatable")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--shared-data",
        type=Path,
        default=Path(os.environ.get("PAVETWIN_SHARED_DATA", ROOT.parent / "shared" / "data")),
        help="folder with real input (osm/*.osm); tests whose file is missing are skipped",
    )


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of the tests' own, instead of the user's."""
    folder = tmp_path_factory.mktemp("cache")
    os.environ["PAVETWIN_CACHE"] = str(folder)
    return folder


@pytest.fixture(scope="session")
def shared_file(request: pytest.FixtureRequest) -> Callable[[str], Path]:
    """The path of real input, a file or folder, by its name below `--shared-data`; skips where it is absent."""
    folder: Path = request.config.getoption("--shared-data")

    def find(name: str) -> Path:
        path = folder / name
        if not path.exists():
            pytest.skip(f"real input {path} is absent (name its folder with --shared-data)")
        return path

    return find


@pytest.fixture(scope="session", autouse=True)
def heeded_interrupt() -> None:
    """A shell's background jobs ignore SIGINT, and so would all that tests start and interrupt."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Exclude all objects made before the first test from garbage collection."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that draw are skipped by name where nothing can draw."""
    drawn = [item for item in items if item.path.parent.name == "render" or "needs_adapter" in item.keywords]
    drawn = [item for item in drawn if (item.path.parent.name, item.path.name) != ("render", "test_adapter.py")]
    if not drawn:
        return
    try:
        find_adapter()
    except PaveTwinError as error:
        for item in drawn:
            item.add_marker(pytest.mark.skip(reason=str(error)))
