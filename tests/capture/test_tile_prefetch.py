"""Tiles of images are made by a process of their own, before the renderer asks for them."""

import multiprocessing
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest

from pavetwin.capture import run
from pavetwin.capture.image_workers import CaptureJob, TilePrefetcher
from pavetwin.capture.images import Order
from pavetwin.capture.platforms import CaptureContext
from pavetwin.capture.run import capture, processes
from pavetwin.capture.samples import CameraSample
from pavetwin.capture.scene_renderer import SceneFrameSource
from pavetwin.capture.settings import CaptureSettings
from pavetwin.render.frame import RenderedFrame
from pavetwin.render.nearby import make_missing, wanted_keys
from pavetwin.scene import scene as scenes
from pavetwin.scene.light import Light
from pavetwin.scene.scene import SCENE_SEED, Scene
from pavetwin.scene.values import GroundMaps, TileKey
from pavetwin.scene.view import View, nadir
from pavetwin.uav.cameras import find_camera
from pavetwin.world.cache import cache_folder
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.folders import contents
from scenes.painter import Painter

NOON = Light(60.0, 180.0)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two streets that cross, with defects."""
    folder = tmp_path_factory.mktemp("ahead") / "cross"
    save_world(damaged("cross", 12), folder)
    return folder


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


def above(x_m: float) -> View:
    return nadir(find_camera("phantom4pro"), (x_m, 0.0, 10.0), yaw_rad=0.0)


def asked_for(scene: Scene, view: View) -> None:
    """Ask for all that a renderer asks for."""
    for key in wanted_keys(scene, view, NOON):
        scene.tile(key)
        scene.maps(key)
        list(scene.patches_on(key))


def is_over(check: Callable[[], bool]) -> bool:
    end = time.monotonic() + 60
    while time.monotonic() < end and not check():
        time.sleep(0.05)
    return check()


def test_a_process_makes_what_frames_will_ask_for_and_nothing_is_made_again(
    world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = [above(x) for x in (10.0, 45.0, 80.0)]
    with TilePrefetcher(world, "varied") as ahead:
        ahead.make([(view, NOON) for view in views])
        last = wanted_keys(Scene(load_world(world), seed=SCENE_SEED), views[-1], NOON)
        assert is_over(lambda: all(list(cache_folder("tiles").rglob(f"{x}_{y}/tile")) for x, y in last))

    def never(*_: object, **__: object) -> None:
        raise AssertionError("made, and not read from the cache")

    for name in ("ground_maps", "ground_pieces", "patch_of", "holes_of", "plan_ground"):
        monkeypatch.setattr(scenes, name, never)
    scene = Scene(load_world(world), seed=SCENE_SEED)
    for view in views:
        asked_for(scene, view)


def test_what_is_there_is_not_made_again(world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, view = Scene(load_world(world), seed=SCENE_SEED), above(45.0)
    asked: list[TileKey] = []
    maps = scene.maps

    def counted(key: TileKey) -> GroundMaps:
        asked.append(key)
        return maps(key)

    monkeypatch.setattr(scene, "maps", counted)
    make_missing(scene, view, NOON)
    assert asked
    before = len(asked)
    make_missing(scene, view, NOON)
    assert len(asked) == before


def test_ground_out_of_view_is_not_made(world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, low = Scene(load_world(world), seed=SCENE_SEED), replace(NOON, sun_elevation_deg=15.0)
    asked: list[TileKey] = []
    monkeypatch.setattr(scene, "maps", asked.append)
    make_missing(scene, above(45.0), low)
    assert asked
    assert set(asked) < set(wanted_keys(scene, above(45.0), low))


def test_a_process_that_cannot_begin_costs_nothing(tmp_path: Path) -> None:
    with TilePrefetcher(tmp_path / "no-such-world", "varied") as ahead:
        ahead.make([(above(10.0), NOON)])
    assert not cache_folder("tiles").exists()


def test_it_ends_with_its_block_wherever_it_has_got_to(world: Path) -> None:
    with TilePrefetcher(world, "varied") as ahead:
        ahead.make([(above(float(x)), NOON) for x in range(90)] * 400)  # more than a pipe holds
        process = ahead._process.process
        assert process.is_alive()
    with pytest.raises(ValueError, match="closed"):
        process.is_alive()
    assert not list(cache_folder("tiles").rglob(".*"))


@pytest.mark.parametrize(
    ("images", "jobs", "is_new", "expected"),
    [
        (1, None, True, (1, True)),
        (1, None, False, (1, False)),
        (60, None, True, (1, True)),
        (60, None, False, (2, True)),
        (60, None, None, (2, False)),
        (100, None, True, (2, True)),
        (60, 1, True, (1, False)),
        (60, 2, True, (1, True)),
        (500, 8, True, (8, True)),
        (399, 8, True, (7, True)),
        (399, 8, False, (8, True)),
        (1, 8, True, (1, True)),
    ],
)
def test_one_of_few_processes_makes_the_tiles_of_a_new_scene(
    monkeypatch: pytest.MonkeyPatch, images: int, jobs: int | None, is_new: bool | None, expected: tuple[int, bool]
) -> None:
    monkeypatch.setattr(run, "cores", lambda: 2)
    monkeypatch.setattr(run, "default_jobs", lambda images: max(1, min(2, images // 10)))
    assert processes(images, jobs, is_new) == expected


def test_on_one_core_nobody_makes_tiles_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "cores", lambda: 1)
    assert processes(60, 2, is_new=True) == (2, False)


def test_a_scene_is_new_until_its_plan_is_in_the_cache(world: Path) -> None:
    loaded, chosen = load_world(world), CaptureSettings(platforms=("uav",), images=1, seed=0, densities=("low",))
    assert SceneFrameSource.is_new(loaded, chosen) is True
    Scene(loaded, seed=SCENE_SEED).make_plan()
    assert SceneFrameSource.is_new(loaded, chosen) is False
    assert SceneFrameSource.is_new(replace(loaded, content_hash=""), chosen) is None


FEW = CaptureSettings(
    platforms=("uav",),
    images=4,
    altitudes_m=(6.0,),
    densities=("low",),
    seed=3,
    size_px=(160, 160),
    split=(1.0, 0.0, 0.0),
)


@dataclass(frozen=True)
class KeptPainter:
    """Paints as if from tiles that the cache keeps."""

    def __call__(self, context: CaptureContext) -> Painter:
        return Painter(context)

    def is_new(self, world: World, settings: CaptureSettings) -> bool | None:  # noqa: ARG002 - as `KeepsTiles` has it
        return True


def test_datasets_prefetch_what_they_will_show(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[View, Light]] = []

    @contextmanager
    def noted(job: CaptureJob) -> Iterator[Callable[[Iterable[Order]], None]]:
        assert job.world == world
        yield lambda orders: asked.extend((each.pose.view, each.daylight.light) for _, each in orders if each)

    monkeypatch.setattr(run, "prefetching", noted)
    monkeypatch.setattr(run, "cores", lambda: 2)
    shown: list[View] = []
    painted = Painter.frame

    def frame(self: Painter, sample: CameraSample, setting: CaptureContext) -> RenderedFrame:
        shown.append(sample.pose.view)
        return painted(self, sample, setting)

    monkeypatch.setattr(Painter, "frame", frame)
    capture(world, FEW, tmp_path / "many", frame_source_factory=KeptPainter(), jobs=2)
    first = [view.position.tolist() for view, _ in asked]
    assert len(first) == FEW.images
    assert [each for each in (view.position.tolist() for view in shown) if each in first] == first
    asked.clear()
    capture(world, FEW, tmp_path / "alone", frame_source_factory=KeptPainter(), jobs=1)
    assert not asked


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_images_are_the_same_with_prefetched_tiles(world: Path, tmp_path: Path) -> None:
    capture(world, FEW, tmp_path / "prefetched", frame_source_factory=SceneFrameSource, jobs=2)
    shutil.rmtree(cache_folder("tiles"))
    capture(world, FEW, tmp_path / "alone", frame_source_factory=SceneFrameSource, jobs=1)
    assert contents(tmp_path / "prefetched") == contents(tmp_path / "alone")


def test_a_cache_that_cannot_be_written_gets_no_tiles(world: Path, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("not a folder")
    assert SceneFrameSource.is_new(load_world(world), FEW) is None


def test_a_worker_process_starts_none_of_its_own() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(partial(processes, 5, None, is_new=True)) == (1, False)
