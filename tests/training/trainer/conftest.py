"""These tests need torch, which is an extra: `make test-train` installs it and runs them. The roads that most learn."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from pavetwin.training.datasets.examples import ExampleSet, read_coco
from scenes.drawn_roads import drawn_roads


class WithoutTorch(pytest.Module):
    """A file of tests that says why it is skipped."""

    def collect(self) -> Iterator[pytest.Item]:
        pytest.skip("torch is not installed; `make test-train` runs these tests", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Import no file of tests here where there is no torch."""
    return WithoutTorch.from_parent(parent, path=module_path) if find_spec("torch") is None else None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of photographs, drawn: twelve to train on, three to validate with."""
    return drawn_roads(tmp_path_factory.mktemp("data"), {"train": 12, "val": 3}, size=(64, 48))


@pytest.fixture(scope="module")
def data(folder: Path) -> list[ExampleSet]:
    """The same, as a training takes it."""
    return [read_coco(folder, ("train", "val"))]
