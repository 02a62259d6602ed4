"""Processes that take shards of images, one or several with the same result, and one that makes tiles ahead."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol, Self, runtime_checkable

from pavetwin.capture.context import prepare
from pavetwin.capture.formats import find_formats
from pavetwin.capture.images import FrameSource, Order, finished_images, write_shard
from pavetwin.capture.platforms import PLATFORMS, CaptureContext, Platform
from pavetwin.capture.settings import CaptureSettings
from pavetwin.errors import PaveTwinError
from pavetwin.memory import give_back
from pavetwin.plugins import load_plugins
from pavetwin.render.nearby import make_missing
from pavetwin.scene.light import Light
from pavetwin.scene.scene import SCENE_SEED, Scene
from pavetwin.scene.view import View
from pavetwin.workers import OnTick, WaitingProcess, WorkerPool, started
from pavetwin.world.model import World
from pavetwin.world.store import load_world

LitView = tuple[View, Light]


class TilePrefetcher:
    """Begins with what all tiles of a world need, and ends with the `with` block, wherever it has got to.

    Nothing depends on it: a missing tile is made by the process that needs it.
    """

    def __init__(self, world: Path, style: str, plugins: Sequence[str] = ()) -> None:
        """Args:
        world: its folder, with its defects.
        style: of its streets: a name, or a YAML file.
        plugins: modules that the world or the style need.
        """
        self._process = WaitingProcess(ahead=partial(_begin_tiles, world, style, tuple(plugins)))
        # The process reads when it has begun, and a pipe holds little: nothing else waits for that.
        self._sender = ThreadPoolExecutor(1)
        self._sender.submit(self._send, _start_tiles)

    def make(self, views: Sequence[LitView]) -> None:
        """Prepare what some frames need, in this order, after earlier requests."""
        self._sender.submit(self._send, views)

    def _send(self, message: object) -> None:
        with suppress(OSError):  # it has died, or been stopped
            self._process.connection.send(message)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.stop()
        self._sender.shutdown(cancel_futures=True)
        self._process.connection.close()


_SCENE: Final[list[Scene]] = []
"""In the process: the scene, once there is one."""


def _begin_tiles(world: Path, style: str, plugins: Sequence[str]) -> None:
    load_plugins(plugins)
    _SCENE[:] = [Scene(load_world(world), seed=SCENE_SEED, style=style)]
    _SCENE[0].make_plan(ahead=True)


def _start_tiles(on_tick: OnTick) -> Callable[[Sequence[LitView]], None]:  # noqa: ARG001 - nothing reports
    return _make_tiles


def _make_tiles(views: Sequence[LitView]) -> None:
    for view, light in views if _SCENE else ():
        with suppress(Exception):  # the process that takes the image raises it too
            make_missing(_SCENE[0], view, light)


FrameSourceFactory = Callable[[CaptureContext], FrameSource]
"""Makes the frame source of one process; defined at module level, so that another process can import it."""


@runtime_checkable
class KeepsTiles(Protocol):
    """A factory whose frames are made from tiles that the cache keeps."""

    def is_new(self, world: World, settings: CaptureSettings) -> bool | None:
        """Return whether the cache has nothing of a scene yet; None if it keeps nothing of it."""
        ...


Shard = Sequence[Order]


@dataclass(frozen=True)
class CaptureJob:
    """Inputs of every process of a pool."""

    world: Path
    settings: CaptureSettings
    folder: Path
    frame_source_factory: FrameSourceFactory


@contextmanager
def image_workers(
    job: CaptureJob, workers: int, on_image: OnTick
) -> Iterator[Callable[[CaptureContext, Sequence[Shard]], None]]:
    """A function that takes shards of images, in the order in which they should begin. Processes start at once, and
    load the world while the context is prepared here.

    Raises:
        PaveTwinError: as raised by any of the processes; the others stop at once.
    """
    if workers == 1:
        worker: list[Callable[[Shard], None]] = []

        def in_process(context: CaptureContext, shards: Sequence[Shard]) -> None:
            if not worker:
                worker.append(_worker(job, context, on_image))
            for shard in shards:
                worker[0](shard)

        try:
            yield in_process
        finally:
            give_back()
        return
    with started(workers, ahead=partial(_load, job)) as waiting, ExitStack() as stack:
        pool: WorkerPool[Shard, None] | None = None

        def by_pool(context: CaptureContext, shards: Sequence[Shard]) -> None:
            nonlocal pool
            if pool is None:
                start = partial(_start, job, context.defect_index.splits)
                pool = stack.enter_context(WorkerPool(workers, start, on_image, waiting))
            pool.run(shards, lambda _shard, _result: None, remaining=partial(_remaining, job.folder), give_up=_give_up)

        yield by_pool


@contextmanager
def prefetching(job: CaptureJob) -> Iterator[Callable[[Iterable[Order]], None]]:
    """A function that has the tiles of images made, in the order in which these will be taken."""
    with TilePrefetcher(job.world, job.settings.style, job.settings.plugins) as process:
        yield lambda orders: process.make([(one.pose.view, one.daylight.light) for _, one in orders if one is not None])


def _remaining(folder: Path, shard: Shard) -> list[Shard]:
    """The rest of a shard that a dead process has not taken."""
    there = finished_images(folder)
    left = [order for order in shard if order[0].name not in there]
    return [left] if left else []


def _give_up(shard: Shard) -> None:
    raise PaveTwinError(
        f"Processes that took the image {shard[0][0].name} and others died several times, perhaps for lack of "
        "memory. Run the same command again to resume, with fewer `jobs`."
    )


def _load(job: CaptureJob) -> World:
    """In a worker process: the world, which a process loads once. Its frame source may need as long as that to begin;
    it begins too, where it can without the traffic."""
    if not _LOADED or _LOADED[0] != job.world:
        _LOADED[:] = [job.world, load_world(job.world)]
        begin = getattr(job.frame_source_factory, "begin", None)
        if begin is not None:
            begin(_LOADED[1], job.settings)
    world: World = _LOADED[1]
    return world


_LOADED: Final[list[Any]] = []
"""The folder of the world that was loaded, and that world."""


def _start(job: CaptureJob, splits: Mapping[str, str], on_image: OnTick) -> Callable[[Shard], None]:
    """Load the world in a worker process and return the function that takes shards."""
    return _worker(job, prepare(_load(job), job.settings, splits=splits), on_image)


def _worker(job: CaptureJob, context: CaptureContext, on_image: OnTick) -> Callable[[Shard], None]:
    platforms = platforms_of(context)
    frame_source, formats = job.frame_source_factory(context), find_formats(job.settings.formats)
    return lambda shard: write_shard(job.folder, shard, platforms, frame_source, formats, on_image)


def platforms_of(context: CaptureContext) -> dict[str, Platform]:
    """The platforms of a dataset, by name."""
    return {name: PLATFORMS.get(name)(context) for name in context.settings.platforms}
