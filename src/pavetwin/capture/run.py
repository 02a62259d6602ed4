"""A dataset from a world: planned, taken in shards, resumed where it stopped, and completed by the label formats."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from pavetwin._core import __version__
from pavetwin.capture.context import check, packages_in_use, prepare
from pavetwin.capture.formats import find_formats
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.image_workers import (
    CaptureJob,
    FrameSourceFactory,
    KeepsTiles,
    image_workers,
    platforms_of,
    prefetching,
)
from pavetwin.capture.images import (
    check_disk_space,
    finished_images,
    in_order,
    schedule,
    split_into_shards,
    write_over_all,
    write_yaml,
)
from pavetwin.capture.platforms import CaptureContext
from pavetwin.capture.record import Statistics, count
from pavetwin.capture.samples import draw_sample, image_name, image_specs, platform_prefix
from pavetwin.capture.settings import FILE, CaptureSettings, check_same, description
from pavetwin.errors import PaveTwinError
from pavetwin.files import working_in
from pavetwin.labels import SPLITS
from pavetwin.mission.inputs import OnProgress
from pavetwin.mission.versions import software_versions
from pavetwin.workers import WORTH_STARTING, cores, default_jobs, may_start
from pavetwin.world.model import World
from pavetwin.world.store import attribution, load_record, load_world

BLOCK: Final = 8192
"""Images whose poses are drawn before the first of them is taken, so that neighbouring ones are taken together."""

PREFETCHED_IMAGES: Final = 50
"""Images a process that take about as long as their tiles, where none of these is in the cache."""

MANIFEST: Final = "manifest.yaml"


@dataclass(frozen=True)
class DatasetSummary:
    """A complete dataset."""

    folder: Path
    statistics: Statistics
    taken: int
    """Images taken by this call; the others existed."""


def capture(
    world_folder: Path,
    settings: CaptureSettings,
    folder: Path,
    *,
    frame_source_factory: FrameSourceFactory,
    adapter: str = "",
    jobs: int | None = 1,
    on_progress: OnProgress | None = None,
) -> DatasetSummary:
    """Take the images of a dataset that do not exist yet, and write the files that its formats have for all images.

    Args:
        frame_source_factory: makes the frame source of each process.
        adapter: name of the graphics adapter; a dataset is not resumed with another one.
        jobs: number of worker processes; it does not change the result. None: by cores, memory and images.

    Raises:
        PaveTwinError: the world or a setting is unsuitable, the folder holds something else, or it cannot be written.
            Images taken so far are kept, and the same call resumes from there.
    """
    if jobs is not None and jobs < 1:
        raise PaveTwinError(f"`jobs` {jobs}: at least one process must take the images.")
    report = on_progress or (lambda _share, _what: None)
    check(settings)
    report(0.0, "Loading the world")
    world = load_world(world_folder)
    versions = software_versions(images=True, adapter=adapter, packages=packages_in_use(settings, world))
    expected = description(settings, world, versions)
    with working_in(folder):
        check_same(folder, expected)
        existing = finished_images(folder)
        check_disk_space(settings, max(settings.total_images - len(existing), 0), folder)
        names = [platform_prefix(world, settings, platform) for platform in settings.platforms]
        missing = {image_name(name, index) for name in names for index in range(settings.images)} - existing
        if missing:
            job = CaptureJob(world_folder, settings, folder, frame_source_factory)
            context = _take(job, world, missing, jobs, partial(write_yaml, folder / FILE, expected), report)
        else:
            context = prepare(world, settings, report)
        report(1.0, "Writing label files")
        statistics = _finish(world, settings, context, folder)
    return DatasetSummary(folder, statistics, len(missing))


def _take(
    job: CaptureJob,
    world: World,
    missing: set[str],
    jobs: int | None,
    write_settings: Callable[[], None],
    report: OnProgress,
) -> CaptureContext:
    """`write_settings` is called when poses have been drawn, before the first image is taken."""
    total = job.settings.total_images
    ready = total - len(missing)

    def on_image() -> None:
        nonlocal ready
        ready += 1
        report(ready / total, f"Taking images {ready}/{total}")

    factory = job.frame_source_factory
    is_new = factory.is_new(world, job.settings) if isinstance(factory, KeepsTiles) else None
    workers, prefetches = processes(len(missing), jobs, is_new)
    preparing = "Preparing the scene" + (f" in {workers} processes" if workers > 1 else "")
    making = prefetching(job) if prefetches else nullcontext(lambda _orders: None)
    with making as make_tiles, image_workers(job, workers, on_image) as work:
        context = prepare(world, job.settings, report)
        platforms = platforms_of(context)
        report(ready / total, preparing)
        for block in _blocks(job.settings, context.world, missing):
            orders = []
            for number, spec in enumerate(block, start=1):
                report(ready / total, f"Drawing poses {number}/{len(block)}")
                orders.append((spec, draw_sample(platforms[spec.platform], spec, 0)))
            write_settings()
            report(ready / total, preparing)
            shards = schedule(split_into_shards(orders, workers), workers)
            make_tiles(in_order(shards, workers))
            work(context, shards)
    return context


def processes(images: int, jobs: int | None, is_new: bool | None) -> tuple[int, bool]:
    """Number of processes that take images, and whether another one makes tiles for them. That one counts among `jobs`
    if so few images are taken of a new scene that its tiles take as long.

    Args:
        jobs: None: by cores, memory and images.
        is_new: whether nothing of the scene is in the cache; None: it has no tiles that are kept.
    """
    most = default_jobs(images) if jobs is None else max(1, min(jobs, -(-images // 2)))
    if is_new is None or jobs == 1 or cores() == 1 or not may_start():
        return most, False
    if is_new:
        return max(1, most - (images < PREFETCHED_IMAGES * most)), True
    return most, images >= WORTH_STARTING


def _blocks(settings: CaptureSettings, world: World, missing: set[str]) -> Iterator[list[ImageSpec]]:
    """The specs whose images are missing, one block at a time."""
    for start in range(0, settings.images, BLOCK):
        count = min(BLOCK, settings.images - start)
        every = [spec for name in settings.platforms for spec in image_specs(settings, world, name, count, start)]
        if inside := [spec for spec in every if spec.name in missing]:
            yield inside


def _finish(world: World, settings: CaptureSettings, context: CaptureContext, folder: Path) -> Statistics:
    splits = tuple(split for split, share in zip(SPLITS, settings.split, strict=True) if share > 0)
    write_over_all(folder, find_formats(settings.formats), splits)
    statistics = count(folder)
    write_yaml(folder / MANIFEST, _manifest(world, context, statistics))
    return statistics


def _manifest(world: World, context: CaptureContext, statistics: Statistics) -> dict[str, Any]:
    """A summary of the dataset for human readers."""
    streets: dict[str, set[str]] = {}
    for segment in world.segments:
        if split := context.defect_index.splits.get(segment.street):
            streets.setdefault(split, set()).add(segment.street_name)
    credit = attribution(load_record(world.folder).source) if world.folder is not None else None
    return {
        "pavetwin": __version__,
        "world": world.name,
        **({"credit": credit} if credit else {}),
        "streets": {split: sorted(streets[split]) for split in SPLITS if split in streets},
        **statistics.as_dict(),
    }
