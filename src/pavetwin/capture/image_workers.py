"""Shards of images by one process or several: the same files either way."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pavetwin.capture.context import prepare
from pavetwin.capture.formats import find_formats
from pavetwin.capture.images import FrameSource
from pavetwin.capture.platforms import PLATFORMS, CaptureContext, Platform
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.shards import Order, finished_images, write_shard
from pavetwin.errors import PaveTwinError
from pavetwin.workers import OnTick, WorkerPool
from pavetwin.world.store import load_world

FrameSourceFactory = Callable[[CaptureContext], FrameSource]
"""Makes the frame source of one process; defined at module level, so that another process can import it."""

Shard = Sequence[Order]


@dataclass(frozen=True)
class CaptureJob:
    """What every process of a pool must know."""

    world: Path
    settings: CaptureSettings
    folder: Path
    frame_source_factory: FrameSourceFactory


@contextmanager
def image_workers(
    job: CaptureJob, context: CaptureContext, workers: int, on_image: OnTick
) -> Iterator[Callable[[Sequence[Shard]], None]]:
    """A function that takes shards of images, in the order in which they should begin.

    Raises:
        PaveTwinError: as raised by any of the processes; the others stop at once.
    """
    if workers == 1:
        work = _worker(job, context, on_image)

        def in_process(shards: Sequence[Shard]) -> None:
            for shard in shards:
                work(shard)

        yield in_process
        return
    with WorkerPool(workers, partial(_start, job), on_image) as pool:
        yield lambda shards: pool.run(
            shards, lambda _shard, _result: None, remaining=partial(_remaining, job.folder), give_up=_give_up
        )


def _remaining(folder: Path, shard: Shard) -> list[Shard]:
    """The rest of a shard that a dead process has not taken."""
    there = finished_images(folder)
    left = [order for order in shard if order[0].name not in there]
    return [left] if left else []


def _give_up(shard: Shard) -> None:
    raise PaveTwinError(
        f"Processes that took the image {shard[0][0].name} and others died several times, perhaps for want of "
        "memory. Give the same command again to resume, with fewer `jobs`."
    )


def _start(job: CaptureJob, on_image: OnTick) -> Callable[[Shard], None]:
    """In a worker process: load the world and make the function that takes shards."""
    return _worker(job, prepare(load_world(job.world), job.settings), on_image)


def _worker(job: CaptureJob, context: CaptureContext, on_image: OnTick) -> Callable[[Shard], None]:
    platforms = platforms_of(context)
    frame_source, formats = job.frame_source_factory(context), find_formats(job.settings.formats)
    return lambda shard: write_shard(job.folder, shard, platforms, frame_source, formats, on_image)


def platforms_of(context: CaptureContext) -> dict[str, Platform]:
    """The platforms of a dataset, by name."""
    return {name: PLATFORMS.get(name)(context) for name in context.settings.platforms}
