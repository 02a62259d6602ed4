"""These tests need torch, which is an extra: `make test-train` installs it and runs them."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest


class WithoutTorch(pytest.Module):
    """A file of tests that says why it is skipped."""

    def collect(self) -> Iterator[pytest.Item]:
        pytest.skip("torch is not installed; `make test-train` runs these tests", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Import no file of tests here where there is no torch."""
    return WithoutTorch.from_parent(parent, path=module_path) if find_spec("torch") is None else None
