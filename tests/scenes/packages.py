"""An installed package whose entry points give a policy and a label format."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pavetwin.capture.formats import FORMATS
from pavetwin.mission import versions
from pavetwin.policies import POLICIES

MODULE = """
from pavetwin.capture.formats import Format
from pavetwin.policies import GoOn, Policy

class Lazy(Policy):
    def decide(self, snapshot):
        return GoOn()

class Bare(Format):
    pass
"""


def release(folder: Path, version: str) -> None:
    """Install a version of the package in place of the one that is there."""
    (folder / "lazy_things.py").write_text(MODULE)
    info = folder / "lazy_things.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: lazy-things\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(
        "[pavetwin.policies]\nlazy = lazy_things:Lazy\n[pavetwin.formats]\nbare = lazy_things:Bare\n"
    )
    versions._version.cache_clear()


@contextmanager
def installed(folder: Path) -> Iterator[None]:
    """Version 1.0 of the package is there, and nothing of it was asked for yet."""
    with pytest.MonkeyPatch.context() as patch:
        release(folder, "1.0")
        patch.syspath_prepend(str(folder))
        for registry in (POLICIES, FORMATS):
            registry.names()
            patch.setattr(registry, "_entries", dict(registry._entries))
            patch.setattr(registry, "_has_installed", False)
        yield
    versions._version.cache_clear()
