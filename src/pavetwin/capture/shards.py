"""Images taken one shard at a time: written to a staging folder, then moved to the dataset, each image's record last.

So an image whose record exists is complete, and a killed run loses at most the images in progress.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Final

from pavetwin.capture.formats import Format
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.images import FrameSource, take_image
from pavetwin.capture.platforms import Platform
from pavetwin.capture.record import record_paths
from pavetwin.capture.samples import CameraSample
from pavetwin.capture.store import link_image, write_image
from pavetwin.files import staging_folder

SHARD: Final = 25
"""Neighbouring images that a process takes in one unit of work; fewer where processes would be left idle."""

_STAGING: Final = "shard"
"""Name of the staging folder; a dot is put before it."""

Order = tuple[ImageSpec, CameraSample | None]
"""An image spec and its first attempt."""


def write_shard(
    folder: Path,
    orders: Sequence[Order],
    platforms: Mapping[str, Platform],
    frame_source: FrameSource,
    formats: Sequence[Format],
    on_image: Callable[[], None],
) -> None:
    """Take the images of a shard and put them into the dataset.

    Args:
        on_image: called after each; an exception from it ends the shard.

    Raises:
        PaveTwinError: an image cannot be taken, or the dataset cannot be written. No partial file is left.
    """
    with staging_folder(folder / _STAGING) as staging:
        for spec, first in orders:
            record, picture = take_image(platforms[spec.platform], frame_source, spec, first)
            *files, truth = write_image(staging, record, picture, formats)
            for path in files:
                _move(staging / path, folder / path)
            link_image(folder, record, formats)
            _move(staging / truth, folder / truth)
            on_image()


def finished_images(folder: Path) -> set[str]:
    """The names of a dataset's finished images."""
    return {path.stem for path in record_paths(folder)}


def split_into_shards(orders: Iterable[Order], workers: int) -> list[list[Order]]:
    """Shards of neighbouring images, so that a process makes few tiles of the scene; at least one shard per worker."""
    along = sorted(orders, key=lambda order: (_morton_code(order[1]), order[0].name))
    size = max(1, min(SHARD, -(-len(along) // workers)))
    return [along[start : start + size] for start in range(0, len(along), size)]


def schedule(shards: Sequence[list[Order]], workers: int) -> list[list[Order]]:
    """The order in which `workers` processes should start the shards: each worker continues next to its last shard."""
    length = -(-len(shards) // workers)
    piles = [shards[start : start + length] for start in range(0, len(shards), max(1, length))]
    return [pile[turn] for turn in range(length) for pile in piles if turn < len(pile)]


def in_order(shards: Sequence[list[Order]], workers: int) -> Iterator[Order]:
    """The images of scheduled shards, about as `workers` processes take them: each its shard at the same time."""
    for first in range(0, len(shards), workers):
        for together in zip_longest(*shards[first : first + workers]):
            yield from filter(None, together)


def _move(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)


def _morton_code(sample: CameraSample | None) -> int:
    """Position along a Z-order curve, which keeps neighbours together (Morton 1966): interleaved bits of column and
    row."""
    if sample is None:
        return 1 << 62
    column, row = (int(value // 32.0) + (1 << 20) for value in sample.pose.view.position[:2])
    return sum(((column >> bit & 1) | (row >> bit & 1) << 1) << 2 * bit for bit in range(21))
