"""Images taken and written into a dataset's folder, one shard at a time.

Camera samples of a spec are rendered until one shows what it must; then its record is made. A shard is written to a
staging folder, then moved to the dataset, each image's record last. So an image with a record is complete, and a killed
run loses at most the images in progress. A full disk is reported before the first image.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import yaml

from pavetwin.capture.daylight import Daylight
from pavetwin.capture.exif import ImageMetadata
from pavetwin.capture.formats import Format
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.platforms import PLATFORMS, CaptureContext, Platform, Pose
from pavetwin.capture.record import Record, record_paths, truth_path
from pavetwin.capture.samples import CameraSample, draw_sample, next_attempt, relaxed
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.truth import LabelledObject, SceneState, labelled_objects
from pavetwin.errors import PaveTwinError
from pavetwin.files import link_or_copy, staging_folder, write_pieces
from pavetwin.perception.drone_tags import encoded
from pavetwin.render.frame import RenderedFrame
from pavetwin.world.model import World


class FrameSource(Protocol):
    """Renders the image of a camera sample, with its ground truth."""

    def frame(self, sample: CameraSample, context: CaptureContext) -> RenderedFrame:
        """The same sample gives the same frame, whatever was rendered before."""
        ...


def take_image(
    platform: Platform, frame_source: FrameSource, spec: ImageSpec, first: CameraSample | None
) -> tuple[Record, bytes]:
    """Take the image of a spec: its record, and the image file's content.

    Args:
        first: the spec's first attempt, as `draw_sample` gives it.

    Raises:
        PaveTwinError: no attempt shows what it must.
    """
    context = platform.context
    attempt, sample = 0, first
    while True:
        if sample is not None:
            frame = frame_source.frame(sample, context)
            seen = labelled_objects(frame, _scene_state(sample, context))
            if meets_spec(sample.spec, seen, context):
                content = {"index": spec.number, "name": spec.name, "split": spec.split, "objects": tuple(seen)}
                content |= {"traffic": _traffic(sample, context), "aim": _aim(sample, spec)}
                return record_of(
                    frame, sample.pose, sample.daylight, context.world, context.settings, spec.platform, **content
                )
        attempt = next_attempt(spec, attempt, sample)
        sample = draw_sample(platform, relaxed(platform, spec, attempt), attempt)


def meets_spec(spec: ImageSpec, seen: list[LabelledObject], context: CaptureContext) -> bool:
    """Return whether visible objects meet a spec: no defect of another split, and one of the aimed classes, or none."""
    defects = [int(obj.id.removeprefix("defect ")) for obj in seen if obj.id.startswith("defect ")]
    if not spec.aims:
        return not defects
    aims = {category.name for category in spec.aims}
    if not any(obj.category in aims and obj.ignored is None for obj in seen):
        return False
    return bool((context.defect_index.split_of[defects] == spec.split).all())


def _scene_state(sample: CameraSample, context: CaptureContext) -> SceneState:
    density = sample.spec.density
    agents = context.traces[density].agents_at(sample.pose.time_s)
    kinds = context.recordings[density].agents.kind
    return SceneState(context.world, agents, kinds, context.parked(sample.conditions, density))


def record_of(
    frame: RenderedFrame,
    pose: Pose,
    daylight: Daylight,
    world: World,
    settings: CaptureSettings,
    platform: str,
    **content: Any,
) -> tuple[Record, bytes]:
    """The record of a frame, and the image file's content.

    Args:
        content: of the record: `index`, `name`, `split`, `traffic`, `aim` and `objects`.
    """
    flies = PLATFORMS.get(platform).uses_altitude
    taken = ImageMetadata(pose, world.georeference, daylight.when, frame.exposure, flies)
    record = Record(
        suffix=f".{settings.picture}",
        size_px=pose.view.size_px,
        camera={"platform": platform, "mount": pose.mount, **taken.as_dict()},
        light=daylight.as_dict(),
        **content,
    )
    return record, encoded(frame.rgb, taken.tags, suffix=settings.picture, quality=settings.quality)


def _traffic(sample: CameraSample, context: CaptureContext) -> dict[str, Any]:
    recording = context.recordings[sample.spec.density]
    ego = {} if sample.pose.ego is None else {"ego": f"agent {sample.pose.ego}"}
    return {
        "density": sample.spec.density,
        "seed": recording.origin.seed,
        "time_s": round(sample.pose.time_s, 4),
        **ego,
    }


def _aim(sample: CameraSample, spec: ImageSpec) -> dict[str, Any]:
    """The requested classes, and those of the spec that the image met."""
    requested, met = ([category.name for category in each.aims] for each in (spec, sample.spec))
    return {"requested": requested, "met": met, "attempt": sample.attempt}


def write_image(folder: Path, record: Record, picture: bytes, formats: Sequence[Format]) -> list[str]:
    """An image's files, the picture once. Returns their paths in the folder, the record last."""
    labels = {path: content for each in formats for path, content in each.of_image(record).items()}
    files = {**labels, record.image: picture, truth_path(record.split, record.name): record.as_bytes()}
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    return list(files)


def link_image(folder: Path, record: Record, formats: Sequence[Format]) -> None:
    """Link the image into the other folders that formats need it in."""
    for each in formats:
        for path in each.links(record):
            link_or_copy(folder / record.image, folder / path)


def write_over_all(folder: Path, formats: Sequence[Format], splits: tuple[str, ...]) -> None:
    """Write the files that formats have for all images, which must exist."""
    for each in formats:
        for split in splits:
            for path, pieces in each.of_split(folder, split):
                write_pieces(folder / path, pieces)
        for path, content in each.of_all(splits).items():
            write_pieces(folder / path, [content])


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    write_pieces(path, [yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True).encode()])


_JPEG: Final = ((50, 75, 92, 100), (0.09, 0.14, 0.28, 1.2))
"""JPEG qualities, and the bytes per pixel at each: means over 24 images of both platforms."""

_PNG: Final = 1.5
_TEXT_BYTES: Final = 15_000  # An image's record and labels


def bytes_of(settings: CaptureSettings, images: int) -> float:
    """Estimated bytes of that many images with their labels."""
    width, height = settings.size_px
    per_px = _PNG if settings.picture == "png" else float(np.interp(settings.quality, *_JPEG))
    return images * (width * height * per_px + _TEXT_BYTES)


def check_disk_space(settings: CaptureSettings, images: int, folder: Path) -> None:
    """Check that that many images fit on the disk.

    Raises:
        PaveTwinError: they do not.
    """
    place = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists())
    needed, free = bytes_of(settings, images), shutil.disk_usage(place).free
    if needed > free:
        raise PaveTwinError(
            f"{images} images take about {_said(needed)}, and {_said(free)} are free where '{folder}' would be; "
            "free some space, choose another folder, or request fewer `images`."
        )


def _said(size: float) -> str:
    return f"{size / 1e9:,.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


SHARD: Final = 25
"""Neighbouring images that a process takes in one unit of work; fewer where processes would be left idle."""

_STAGING: Final = "shard"  # Name of the staging folder; a dot is put before it

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
