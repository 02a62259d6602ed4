"""Textures that no world changes are made once and kept in the cache."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from pavetwin.scene.texture_cache import kept
from pavetwin.world.cache import cache_folder
from pavetwin.world.folder import CACHE_VARIABLE


class Maker:
    """Makes a small texture, and counts how often."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> Mapping[str, np.ndarray]:
        self.made += 1
        return {"b": np.arange(256, dtype=np.uint8).reshape(8, 8, 4), "a": np.array(2.5)}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return cache_folder("textures")


def is_whole(found: Mapping[str, np.ndarray]) -> bool:
    return list(found) == ["b", "a"] and found["a"] == 2.5 and np.array_equal(found["b"], Maker()()["b"])


def test_a_texture_is_made_once_for_each_seed(folder: Path) -> None:
    maker = Maker()
    assert all(is_whole(kept("grain", maker)) for _ in range(2))
    assert maker.made == 1
    assert is_whole(kept("grain", maker, variant=1))
    assert maker.made == 2
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("kept_bytes", [0, 100, 400])
def test_a_damaged_file_is_made_again(folder: Path, kept_bytes: int) -> None:
    maker = Maker()
    kept("grain", maker)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[:kept_bytes] + bytes(len(whole) - kept_bytes))
    assert is_whole(kept("grain", maker))
    assert maker.made == 2
    assert path.read_bytes() == whole


def test_an_empty_file_is_made_again(folder: Path) -> None:
    kept("grain", Maker())
    (path,) = folder.iterdir()
    path.write_bytes(b"")
    assert is_whole(kept("grain", Maker()))
    assert path.stat().st_size > 0


def test_where_nothing_can_be_written_each_process_makes_its_own(folder: Path) -> None:
    folder.parent.mkdir()
    folder.write_text("not a folder")
    maker = Maker()
    assert all(is_whole(kept("grain", maker)) for _ in range(2))
    assert maker.made == 2


def test_the_last_three_files_of_a_name_are_kept(folder: Path) -> None:
    for seed in range(5):
        kept("grain", Maker(), seed)
        (path,) = folder.glob(f"grain-*-{seed}.npz")
        os.utime(path, (seed, seed))  # a clock may be too coarse to tell them apart
    kept("leaves", Maker())
    assert {path.stem.rpartition("-")[2] for path in folder.glob("grain-*")} == {"2", "3", "4"}
    assert len(list(folder.iterdir())) == 4
