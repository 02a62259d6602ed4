"""Tiles are made once and kept in the cache: the same to the bit, whatever happens to their files."""

import multiprocessing
import os
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from threading import Event
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from shapely.geometry.base import BaseGeometry

from pavetwin.defects import DefectOptions, place
from pavetwin.errors import CacheWarning
from pavetwin.files import file_lock
from pavetwin.scene import scene as scene_cache
from pavetwin.scene import scene as scenes_module
from pavetwin.scene.ground import ground_plan as plans
from pavetwin.scene.scene import Scene, SceneCache, kept_of_all
from pavetwin.scene.values import GroundMaps, Mesh, Model
from pavetwin.world import cache as kept
from pavetwin.world.cache import cache_folder
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World
from scenes import tiny

KEY = (0, 0)


@pytest.fixture(scope="module")
def world() -> World:
    """A street with a house and a few defects, with a content hash as every world has that was built."""
    street = tiny.street("street", (0.0, 0.0), (30.0, 0.0))
    defects = place([street], 5, DefectOptions(population="paper", per_segment=4))
    return replace(
        tiny.world([street], defects, buildings=[tiny.block("house", 5.0, 12.0, 20.0, 24.0, 8.0)]), content_hash="5"
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return cache_folder("tiles")


def parts(value: Any) -> Iterator[object]:
    """What a value consists of, in order, arrays as their bytes with shape and type."""
    if is_dataclass(value) and not isinstance(value, type):
        yield type(value)
        for field in fields(value):
            yield from parts(getattr(value, field.name))
    elif isinstance(value, np.ndarray) and value.dtype != object:
        yield value.dtype, value.shape, value.flags.f_contiguous, value.tobytes()
    elif isinstance(value, tuple | list | np.ndarray):
        yield type(value), len(value)
        for each in value:
            yield from parts(each)
    elif isinstance(value, dict):
        yield from parts(list(value.items()))
    elif isinstance(value, BaseGeometry):
        yield value.wkb
    else:
        yield type(value), repr(value)


def everything(scene: Scene) -> list[object]:
    """All that a renderer asks of a tile, and the plan that it is made from."""
    plan = scene._plan
    made = [scene.tile(KEY), scene.maps(KEY), *scene.patches_on(KEY), scene.hole(0), scene._thin(KEY)]
    return list(parts([*made, plan.paint, plan.repairs, plan.fixtures, scene.heights([(3.0, 3.5)])]))


def test_a_second_process_reads_the_same_to_the_bit(
    world: World, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = everything(Scene(world, seed=4))
    without = everything(Scene(replace(world, content_hash=""), seed=4))

    def never(*_: object, **__: object) -> None:
        raise AssertionError("made, and not read from the cache")

    for module, names in (
        (scenes_module, ("ground_maps", "ground_pieces", "patch_of", "holes_of", "fixtures")),
        (plans, ("repairs", "markings", "placed")),
    ):
        for name in names:
            monkeypatch.setattr(module, name, never)
    assert everything(Scene(world, seed=4)) == first == without
    assert not list(folder.rglob(".*")), "temporary files are gone"


def test_other_inputs_are_other_files(world: World, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def place_of(world: World, seed: int = 4, style: str = "varied") -> str:
        SceneCache(world, seed=seed, style=style).kept("value", lambda: 1)
        return max(folder.iterdir(), key=lambda path: path.stat().st_ctime_ns).name

    names = [
        place_of(world),
        place_of(world, seed=5),
        place_of(world, style="uniform"),
        place_of(replace(world, content_hash="6")),
        place_of(replace(world, defects=world.defects[1:])),
        place_of(replace(world, streets=tuple(replace(each, bridges=((1.0, 2.0),)) for each in world.streets))),
    ]
    monkeypatch.setattr(scene_cache, "made_by", lambda *_: "by other code")
    names.append(place_of(world))
    assert len({*names}) == len(names) == len(list(folder.iterdir()))


def test_a_world_that_was_never_built_leaves_nothing(world: World, folder: Path) -> None:
    SceneCache(replace(world, content_hash=""), seed=4, style="varied").kept("value", lambda: 1)
    assert not folder.exists()


class Maker:
    """Makes a value, and counts how often."""

    made = 0

    def __call__(self) -> GroundMaps:
        self.made += 1
        return GroundMaps(np.arange(64, dtype=np.uint8).reshape(4, 4, 4), np.zeros((4, 4, 4), np.uint8))


@pytest.mark.parametrize("damage", [b"", b"too short", bytes(200)])
def test_a_damaged_file_is_made_again_and_that_is_reported_once(world: World, folder: Path, damage: bytes) -> None:
    cache, maker = SceneCache(world, seed=4, style="varied"), Maker()
    cache.kept("one", maker)
    (path,) = (file for file in folder.rglob("*") if file.is_file())
    whole = path.read_bytes()
    path.write_bytes(damage)
    flipped = path.with_name("two")
    flipped.write_bytes(whole[:-20] + bytes([whole[-20] ^ 1]) + whole[-19:])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        for name in ("one", "two", "one", "two"):
            assert list(parts(cache.kept(name, maker))) == list(parts(Maker()()))
    assert maker.made == 3
    assert path.read_bytes() == flipped.read_bytes() == whole
    (warning,) = said
    assert warning.category is CacheWarning
    assert "damaged" in str(warning.message)


def test_where_nothing_can_be_written_each_process_makes_its_own_and_that_is_reported_once(
    world: World, folder: Path
) -> None:
    folder.parent.parent.mkdir(exist_ok=True)
    folder.parent.write_text("not a folder")
    cache, maker = SceneCache(world, seed=4, style="varied"), Maker()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("once")
        for name in ("one", "two"):
            assert list(parts(cache.kept(name, maker))) == list(parts(Maker()()))
    assert maker.made == 2
    assert [each.category for each in said] == [CacheWarning] * len(said)
    (told,) = (str(each.message) for each in said if "cannot be written" in str(each.message))
    assert CACHE_VARIABLE in told


def test_a_disk_that_fills_up_costs_nothing_but_the_file(
    world: World, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.warns(CacheWarning, match="No space left on device"):
        SceneCache(world, seed=4, style="varied").kept("one", Maker())
    assert not [path for path in folder.rglob("*") if path.is_file()]


class SlowMaker(Maker):
    """Tells when it has begun, and goes on when it may."""

    def __init__(self) -> None:
        self.begun, self.may_end = Event(), Event()

    def __call__(self) -> GroundMaps:
        self.begun.set()
        assert self.may_end.wait(20)
        return super().__call__()


def test_a_process_waits_for_what_another_makes(world: World, folder: Path) -> None:
    cache, slow, others = SceneCache(world, seed=4, style="varied"), SlowMaker(), Maker()
    with ThreadPoolExecutor(9) as pool:
        first = pool.submit(cache.kept, "one", slow)
        assert slow.begun.wait(20)
        waiting = [pool.submit(cache.kept, "one", others) for _ in range(8)]
        assert not any(each.done() for each in waiting)
        slow.may_end.set()
        assert all(list(parts(each.result(20))) == list(parts(first.result(20))) for each in waiting)
    assert (slow.made, others.made) == (1, 0)
    assert [path.name for path in folder.rglob("*") if path.is_file()] == ["one"]


@pytest.mark.usefixtures("folder")
def test_a_process_that_hangs_is_not_waited_for_for_ever(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "LOCK_TIMEOUT_S", 0.05)
    cache, hanging, maker = SceneCache(world, seed=4, style="varied"), SlowMaker(), Maker()
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(cache.kept, "one", hanging)
        assert hanging.begun.wait(20)
        cache.kept("one", maker)
        hanging.may_end.set()
        first.result(20)
    assert (hanging.made, maker.made) == (1, 1)


def test_a_killed_process_keeps_no_other_waiting(world: World, folder: Path) -> None:
    cache, maker = SceneCache(world, seed=4, style="varied"), Maker()
    cache.kept("any", Maker())
    (place,) = folder.iterdir()
    owner = multiprocessing.get_context("spawn").Process(target=hold, args=(place / "one",))
    owner.start()
    while not (place / ".one.lock").exists():
        time.sleep(0.01)
    owner.kill()
    owner.join()
    assert cache.kept("one", maker) is not None
    assert maker.made == 1
    assert not (place / ".one.lock").exists()


def hold(path: Path) -> None:
    """Make a value for ever."""
    with file_lock(path, 10.0):
        time.sleep(600)


def test_a_file_can_run_no_code(world: World, folder: Path, tmp_path: Path) -> None:
    class Harm:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "harm"),)

    cache, maker = SceneCache(world, seed=4, style="varied"), Maker()
    cache.kept("one", maker)
    (path,) = (file for file in folder.rglob("*") if file.is_file())
    kept.write(path, Harm())
    with pytest.warns(CacheWarning, match="damaged"):
        cache.kept("one", maker)
    assert maker.made == 2
    assert not (tmp_path / "harm").exists()


@pytest.mark.usefixtures("folder")
def test_models_are_kept_with_their_parts() -> None:
    mesh = Mesh(np.zeros((3, 3), np.float32), np.zeros((3, 3), np.float32), np.zeros((1, 3), np.uint32))
    made = {"box": Model("box", MappingProxyType({"body": mesh}), {"radius_m": 1.5}, "child")}
    assert kept_of_all("models", lambda: made) is made
    found = kept_of_all("models", dict)["box"]
    assert list(parts(found.parts["body"])) == list(parts(mesh))
    assert (found.name, found.extras, found.person) == ("box", {"radius_m": 1.5}, "child")
    with pytest.raises(TypeError):
        found.parts["other"] = mesh  # type: ignore[index]
