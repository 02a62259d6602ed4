"""A dataset from a world: planned, taken in shards, gone on with where it stopped, and finished by the formats."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from pavetwin.capture.disk_space import check_disk_space
from pavetwin.capture.formats import find_formats
from pavetwin.capture.image_workers import FrameSourceFactory, Job, image_workers
from pavetwin.capture.plan import ImageSpec, image_specs
from pavetwin.capture.platforms import PLATFORMS, CaptureContext, Platform
from pavetwin.capture.samples import draw_sample
from pavetwin.capture.setting import OnProgress, check, defects_hash, prepare
from pavetwin.capture.settings import FILE, SPLITS, CaptureSettings, check_same, description
from pavetwin.capture.shards import Order, dealt, done, in_shards
from pavetwin.capture.statistics import Statistics, count
from pavetwin.capture.store import write_over_all, write_yaml
from pavetwin.errors import PaveTwinError
from pavetwin.files import working_in
from pavetwin.world.model import World
from pavetwin.world.store import attribution, load_record, load_world

BLOCK: Final = 8192
"""Images whose places are known before the first of them is taken, so that neighbours are taken together."""

MANIFEST: Final = "manifest.yaml"


@dataclass(frozen=True)
class DatasetSummary:
    """A dataset that is complete."""

    folder: Path
    statistics: Statistics
    taken: int
    """Images taken now; the others were there."""


def capture(
    world_folder: Path,
    settings: CaptureSettings,
    folder: Path,
    *,
    frame_source_factory: FrameSourceFactory,
    adapter: str = "",
    jobs: int = 1,
    on_progress: OnProgress | None = None,
) -> DatasetSummary:
    """Take a dataset's images, those that are not there yet, and write what its formats have over all of them.

    Args:
        hire: makes the photographer of each process.
        adapter: names what it draws with; a dataset is not gone on with on another.
        jobs: processes at work at a time; they change nothing but the time it takes.

    Raises:
        PaveTwinError: the world or a setting does not serve, the folder holds something else, or it cannot be written.
            What was taken stays, and the same call goes on from there.
    """
    if jobs < 1:
        raise PaveTwinError(f"--jobs {jobs}: at least one process must take the images.")
    tell = on_progress or (lambda _share, _what: None)
    check(settings)
    tell(0.0, "Loading the world")
    world = load_world(world_folder)
    wanted = description(settings, world.name, world.content_hash, defects_hash(world), adapter)
    with working_in(folder):
        check_same(folder, wanted)
        there = done(folder)
        missing = [index for index in range(settings.images) if index not in there]
        check_disk_space(settings, len(missing), folder)
        setting = prepare(world, settings, tell)

        def begin() -> None:
            write_yaml(folder / FILE, wanted)

        if missing:
            _take(Job(world_folder, settings, folder, frame_source_factory), setting, missing, jobs, begin, tell)
        tell(1.0, "Writing label files")
        statistics = _finish(world, settings, setting, folder)
    return DatasetSummary(folder, statistics, len(missing))


def _take(
    job: Job, setting: CaptureContext, missing: list[int], jobs: int, begin: Callable[[], None], tell: OnProgress
) -> None:
    """`begin` is called when places have been found, before the first image is taken."""
    total, ready = job.settings.images, job.settings.images - len(missing)
    platform = PLATFORMS.get(job.settings.platform)(setting)

    def on_image() -> None:
        nonlocal ready
        ready += 1
        tell(ready / total, f"Taking images {ready}/{total}")

    workers = min(jobs, -(-len(missing) // 2))
    begins = "Preparing the scene" + (f" in {workers} processes" if workers > 1 else "")
    tell(ready / total, begins)
    with image_workers(job, setting, workers, on_image) as work:
        for block in _blocks(job.settings, setting.world, missing):
            orders = [
                _planned(platform, spec, number, len(block), tell, ready / total) for number, spec in enumerate(block)
            ]
            begin()
            tell(ready / total, begins)
            work(dealt(in_shards(orders, workers), workers))


def _planned(platform: Platform, spec: ImageSpec, number: int, total: int, tell: OnProgress, share: float) -> Order:
    tell(share, f"Finding places {number + 1}/{total}")
    return spec, draw_sample(platform, spec, 0)


def _blocks(settings: CaptureSettings, world: World, missing: list[int]) -> Iterator[list[ImageSpec]]:
    """The wishes that are still open, a block at a time."""
    for start in range(0, settings.images, BLOCK):
        inside = set(range(start, min(start + BLOCK, settings.images))).intersection(missing)
        if inside:
            every = image_specs(settings, world, BLOCK, start)
            yield [spec for spec in every if spec.index in inside]


def _finish(world: World, settings: CaptureSettings, setting: CaptureContext, folder: Path) -> Statistics:
    splits = tuple(split for split, share in zip(SPLITS, settings.split, strict=True) if share > 0)
    write_over_all(folder, find_formats(settings.formats), splits)
    statistics = count(folder)
    write_yaml(folder / MANIFEST, _manifest(world, setting, statistics))
    return statistics


def _manifest(world: World, setting: CaptureContext, statistics: Statistics) -> dict[str, Any]:
    """What is in the dataset, for people."""
    streets: dict[str, list[str]] = {}
    for street, split in sorted(setting.sight.splits.items()):
        streets.setdefault(split, []).append(street)
    credit = attribution(load_record(world.folder).source) if world.folder is not None else None
    return {
        "pavetwin": version("pavetwin"),
        "world": world.name,
        **({"credit": credit} if credit else {}),
        "streets": {split: streets[split] for split in SPLITS if split in streets},
        **statistics.as_dict(),
    }
