"""Shards of images by one process or several: the same files either way."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import Empty
from typing import Any

from pavetwin.capture.formats import find_formats
from pavetwin.capture.images import FrameSource
from pavetwin.capture.platforms import Setting, find_platform
from pavetwin.capture.setting import prepare
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.shards import Order, write_shard
from pavetwin.errors import PaveTwinError
from pavetwin.processes import serve_parent
from pavetwin.world.store import load_world

FrameSourceFactory = Callable[[Setting], FrameSource]
"""Makes the photographer of one process; named at the top of a module, so that another process finds it."""

Work = Callable[[Sequence[Order]], None]

_TICK_S = 0.2


@dataclass(frozen=True)
class Job:
    """What every process of a crew must know."""

    world: Path
    settings: CaptureSettings
    folder: Path
    frame_source_factory: FrameSourceFactory


@contextmanager
def image_workers(
    job: Job, setting: Setting, workers: int, on_image: Callable[[], None]
) -> Iterator[Callable[..., None]]:
    """Who takes the images: call it with shards, in the order in which they should begin.

    Raises:
        PaveTwinError: what any of them says; those that are at work stop after their image.
    """
    if workers == 1:
        work = _worker(job, setting, on_image)

        def alone(shards: Sequence[Sequence[Order]]) -> None:
            for shard in shards:
                work(shard)

        yield alone
        return
    context = multiprocessing.get_context("spawn")
    ticks, stop = context.Queue(), context.Event()
    with ProcessPoolExecutor(workers, context, initializer=_begin, initargs=(job, ticks, stop)) as pool:

        def together(shards: Sequence[Sequence[Order]]) -> None:
            futures = {pool.submit(_work, shard) for shard in shards}
            while futures:
                ended, futures = wait(futures, timeout=_TICK_S, return_when=FIRST_COMPLETED)
                _drain(ticks, on_image)
                _raise_first(ended)

        try:
            yield together
        except BrokenProcessPool as error:
            raise PaveTwinError(
                "A process that took images was ended from outside, perhaps for want of memory. Give the same command "
                "again to go on, with fewer --jobs."
            ) from error
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def _raise_first(ended: set[Future[None]]) -> None:
    for future in ended:
        future.result()


def _drain(ticks: Any, on_image: Callable[[], None]) -> None:
    while True:
        try:
            ticks.get_nowait()
        except Empty:
            return
        on_image()


def _worker(job: Job, setting: Setting, on_image: Callable[[], None]) -> Work:
    platform = find_platform(job.settings.platform)(setting)
    frame_source, formats = job.frame_source_factory(setting), find_formats(job.settings.formats)
    return lambda shard: write_shard(job.folder, shard, platform, frame_source, formats, on_image)


# --- In another process ---------------------------------------------------------------------------------------------

_at_work: list[Work] = []
"""The worker of this process, once it has begun."""


class _StoppedError(Exception):
    """The others failed, or the user had enough."""


def _begin(job: Job, ticks: Any, stop: Any) -> None:
    """Set up one process of the crew."""
    serve_parent()

    def on_image() -> None:
        ticks.put(1)
        if stop.is_set():
            raise _StoppedError

    def begin_and_work(shard: Sequence[Order]) -> None:
        # On the first shard, not before: what an initialiser raises is lost.
        _at_work[:] = [_worker(job, prepare(load_world(job.world), job.settings), on_image)]
        _at_work[0](shard)

    _at_work[:] = [begin_and_work]


def _work(shard: Sequence[Order]) -> None:
    _at_work[0](shard)
