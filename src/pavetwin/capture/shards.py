"""Images taken a shard at a time: made in a folder aside, then each file moved to its place, an image's record last.

So an image whose record is there is whole, and a killed run costs at most the images in work.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

from pavetwin.capture.formats import Format
from pavetwin.capture.images import FrameSource, take
from pavetwin.capture.plan import ImageSpec
from pavetwin.capture.platforms import Platform
from pavetwin.capture.record import Record, record_paths, truth_path
from pavetwin.capture.samples import CameraSample
from pavetwin.capture.store import files_of, link_image, write_image
from pavetwin.files import staging_folder

SHARD: Final = 25
"""Images that a process takes in one go, beside each other; fewer where that leaves a process without work."""

_ASIDE: Final = "shard"
"""What the folder aside is named after; it begins with a dot."""

Order = tuple[ImageSpec, CameraSample | None]
"""A wish, and its first attempt."""


def write_shard(
    folder: Path,
    orders: Sequence[Order],
    platform: Platform,
    frame_source: FrameSource,
    formats: Sequence[Format],
    on_image: Callable[[], None],
) -> None:
    """Take the images of a shard and put them into the dataset.

    Args:
        on_image: called after each; an exception from it ends the shard.

    Raises:
        PaveTwinError: an image cannot be taken, or the dataset cannot be written. Nothing half-written is left.
    """
    with staging_folder(folder / _ASIDE) as aside:
        for spec, first in orders:
            record, picture = take(platform, frame_source, spec, first)
            write_image(aside, record, picture, formats)
            _move(aside, folder, record, formats)
            on_image()


def done(folder: Path) -> set[int]:
    """The images that are in a dataset."""
    return {int(path.stem) for path in record_paths(folder)}


def in_shards(orders: Iterable[Order], workers: int) -> list[list[Order]]:
    """Neighbours in one shard, so that a process makes as few tiles of the scene as can be; enough shards for all."""
    along = sorted(orders, key=lambda order: (_place(order[1]), order[0].index))
    size = max(1, min(SHARD, -(-len(along) // workers)))
    return [along[start : start + size] for start in range(0, len(along), size)]


def dealt(shards: Sequence[list[Order]], workers: int) -> list[list[Order]]:
    """The shards in the order in which `workers` processes should begin them: each goes on beside where it was."""
    length = -(-len(shards) // workers)
    piles = [shards[start : start + length] for start in range(0, len(shards), max(1, length))]
    return [pile[turn] for turn in range(length) for pile in piles if turn < len(pile)]


def _move(aside: Path, folder: Path, record: Record, formats: Sequence[Format]) -> None:
    truth = truth_path(record.split, record.index)
    for path in (*files_of(record, formats), record.image):
        _into(aside / path, folder / path)
    link_image(folder, record, formats)
    _into(aside / truth, folder / truth)


def _into(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)


def _place(sample: CameraSample | None) -> int:
    """Along a curve that keeps neighbours together (Morton 1966): the bits of column and row in turn."""
    if sample is None:
        return 1 << 62
    column, row = (int(value // 32.0) + (1 << 20) for value in sample.pose.view.position[:2])
    return sum(((column >> bit & 1) | (row >> bit & 1) << 1) << 2 * bit for bit in range(21))
