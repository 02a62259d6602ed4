"""Packed datasets: pictures as WebP and their labels in one file, to be taken to another machine.

A ZIP archive: `labels.json`, and the pictures uncompressed in `pictures/`, so that each is read by its place in the
file. Masks are run lengths within their boxes; masks of ignored objects, from which nothing is learned, are left out.
"""

import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import file_digest
from io import BytesIO
from math import ceil, floor
from pathlib import Path
from struct import unpack_from
from typing import Any, BinaryIO, Final

import numpy as np
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, writing
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.rle import encode
from pavetwin.training.datasets.examples import (
    SPLITS_USED,
    Example,
    ExampleSet,
    RunLengths,
    Shape,
    TrueObject,
    mask_in,
    read_coco,
)

LABELS: Final = "labels.json"
PICTURES: Final = "pictures"

MEGABYTE: Final = 10**6

LESS: Final = (90, 80, 70, 60, 50, 40, 30)  # Qualities that are tried in turn where a higher one needs too much room
_SAMPLED: Final = 40  # Pictures by which the room is estimated before all are encoded
_LOCAL_HEADER: Final = 30  # Bytes before the name in a ZIP archive's entry


@dataclass(frozen=True, slots=True)
class PackOptions:
    """Limits of a packed file."""

    most_mb: float = 60.0
    """Size of the file in millions of bytes, at most."""
    quality: int = 90
    """WebP quality, 1 to 100; lowered if the file would become too large."""
    longest_px: int = 0
    """Longer side of the pictures, at most; 0 keeps their size."""

    def __post_init__(self) -> None:
        """Raises:
        PaveTwinError: a value is out of its range.
        """
        for name, low, high in (("most_mb", 0.001, 100_000), ("quality", 1, 100)):
            if not low <= getattr(self, name) <= high:
                raise PaveTwinError(f"`{name}` {getattr(self, name):g}: it must be from {low:g} to {high:g}.")
        if self.longest_px and not 32 <= self.longest_px <= 8192:
            raise PaveTwinError(f"`longest_px` {self.longest_px}: it must be from 32 to 8192.")


@dataclass(frozen=True, slots=True)
class PackSummary:
    """Result of packing."""

    images: int
    size_mb: float
    quality: int


def write_pack(
    sets: Sequence[ExampleSet], path: Path, options: PackOptions, on_progress: Callable[[float], None] | None = None
) -> PackSummary:
    """Pack datasets into one file, which replaces one that is there.

    Raises:
        PaveTwinError: they have no images, a picture cannot be read, or they do not fit at the lowest quality.
    """
    members = [(data, example) for data in sets for example in data.examples]
    if not members:
        raise PaveTwinError("The datasets have no images to pack.")
    labels = [_row(at, _scaled(example, options.longest_px)) for at, (_, example) in enumerate(members)]
    text = json.dumps({"format": FORMAT, "images": labels}, ensure_ascii=False).encode()
    limit = options.most_mb * MEGABYTE
    report = on_progress or (lambda _: None)
    step = max(1, len(members) // _SAMPLED)
    sample = members[::step]
    needed = 0.0
    for quality in (options.quality, *(each for each in LESS if each < options.quality)):
        sampled = sum(len(_encoded(*member, options.longest_px, quality)) for member in sample)
        needed = sampled / len(sample) * len(members)
        if needed > limit:
            continue
        pictures = []
        for at, member in enumerate(members):
            pictures.append(_encoded(*member, options.longest_px, quality))
            report((at + 1) / len(members))
        size = _write(path, text, labels, pictures, limit)
        if size is not None:
            return PackSummary(len(members), size / MEGABYTE, quality)
    raise PaveTwinError(
        f"{len(members)} images need about {needed / MEGABYTE:.1f} MB at the lowest quality, and `most_mb` is "
        f"{options.most_mb:g}; pack fewer images or smaller ones (`longest_px`)."
    )


def _write(path: Path, text: bytes, labels: list[dict[str, Any]], pictures: list[bytes], limit: float) -> int | None:
    """Write the file; None, and nothing is written, where it is too large."""
    archive = BytesIO()
    # A fixed date: the same data give the same bytes.
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as held:
        held.writestr(zipfile.ZipInfo(LABELS), text, compress_type=zipfile.ZIP_DEFLATED)
        for row, picture in zip(labels, pictures, strict=True):
            held.writestr(zipfile.ZipInfo(f"{PICTURES}/{row['picture']}"), picture)
    if archive.tell() > limit:
        return None
    with writing(path) as temporary:
        temporary.write_bytes(archive.getbuffer())
    return archive.tell()


def _encoded(data: ExampleSet, example: Example, longest_px: int, quality: int) -> bytes:
    try:
        picture = Image.open(BytesIO(data.encoded(example))).convert("RGB")
        size = _size(example.size_px, longest_px)
        if size != picture.size:
            picture = picture.resize(size, Image.Resampling.LANCZOS)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PaveTwinError(f"The picture '{example.name}' of '{data.path}' cannot be read: {error}.") from error
    stream = BytesIO()
    picture.save(stream, "WEBP", quality=quality, method=4)
    return stream.getvalue()


def _size(size: tuple[int, int], longest_px: int) -> tuple[int, int]:
    scale = min(1.0, longest_px / max(size)) if longest_px else 1.0
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _scaled(example: Example, longest_px: int) -> Example:
    """An example at the size of its packed picture, its masks within their boxes."""
    size = _size(example.size_px, longest_px)
    across, down = size[0] / example.size_px[0], size[1] / example.size_px[1]
    objects = tuple(
        replace(
            each,
            box=(each.box[0] * across, each.box[1] * down, each.box[2] * across, each.box[3] * down),
            shape=_within(each.shape, each.box, (across, down)) if each.shape and not each.is_ignored else None,
        )
        for each in example.objects
    )
    gsd_mm = example.gsd_mm / across if example.gsd_mm is not None else None
    return replace(example, size_px=size, gsd_mm=gsd_mm, objects=objects)


def _within(shape: Shape, box: FloatBox, scale: tuple[float, float]) -> RunLengths:
    """A mask's pixels in its box, scaled."""
    left, top = floor(box[0] * scale[0]), floor(box[1] * scale[1])
    right, bottom = ceil(box[2] * scale[0]), ceil(box[3] * scale[1])
    source = (left / scale[0], top / scale[1], right / scale[0], bottom / scale[1])
    x, y = floor(source[0]), floor(source[1])
    pixels = Image.fromarray(mask_in(shape, (x, y, ceil(source[2]), ceil(source[3]))))
    inner = (source[0] - x, source[1] - y, source[2] - x, source[3] - y)
    small = np.asarray(pixels.resize((right - left, bottom - top), Image.Resampling.BOX, box=inner)) > 127
    return RunLengths(encode(small), (bottom - top, right - left), (left, top))


def _row(number: int, example: Example) -> dict[str, Any]:
    """Args:
    number: of the example, which names its picture: several datasets may have pictures of one name.
    """
    return {
        "name": example.name,
        "picture": f"{number:06}.webp",
        "split": example.split,
        "size": list(example.size_px),
        "source": example.source,
        "synthetic": example.is_synthetic,
        "gsd_mm": example.gsd_mm,
        "from_road": example.is_from_road,
        "objects": [_object(each) for each in example.objects],
    }


def _object(true: TrueObject) -> dict[str, Any]:
    row: dict[str, Any] = {
        "category": true.category,
        "coarse": true.coarse,
        "subtype": true.subtype,
        "box": [round(value, 3) for value in true.box],
        "ignored": true.is_ignored,
    }
    if true.is_pasted:
        row["pasted"] = True
    if isinstance(true.shape, RunLengths):
        row["mask"] = [true.shape.counts, *true.shape.size, *true.shape.origin]
    return row


def read_pack(path: Path, splits: tuple[str, ...]) -> ExampleSet:
    """The examples of a packed file.

    Raises:
        PaveTwinError: it cannot be read, or is not a packed dataset of this version.
    """
    try:
        with path.open("rb") as file:
            digest = file_digest(file, "sha256").hexdigest()
            with zipfile.ZipFile(file) as held:
                content = json.loads(held.read(LABELS))
                check_format(content["format"], f"'{path}'")
                places = {each.filename: _place(file, each) for each in held.infolist()}
        rows = [row for row in content["images"] if row["split"] in splits]
        examples = tuple(_example(row, places[f"{PICTURES}/{row['picture']}"]) for row in rows)
    except OSError as error:
        raise PaveTwinError(f"'{path}' cannot be read: {error.strerror or error}.") from error
    except (zipfile.BadZipFile, ValueError, KeyError, TypeError, IndexError) as error:
        raise PaveTwinError(f"'{path}' is not a packed dataset, or damaged; `pavetwin data pack` makes one.") from error
    return ExampleSet(path, digest, examples)


def _place(file: BinaryIO, entry: zipfile.ZipInfo) -> tuple[int, int]:
    """Offset and length of an uncompressed entry's content."""
    file.seek(entry.header_offset)
    name, extra = unpack_from("<HH", file.read(_LOCAL_HEADER), 26)
    return entry.header_offset + _LOCAL_HEADER + name + extra, entry.compress_size


def _example(row: dict[str, Any], place: tuple[int, int]) -> Example:
    return Example(
        name=row["name"],
        split=row["split"],
        size_px=(row["size"][0], row["size"][1]),
        source=row["source"],
        is_synthetic=row["synthetic"],
        place=place,
        gsd_mm=row["gsd_mm"],
        is_from_road=row["from_road"],
        objects=tuple(_true_object(each) for each in row["objects"]),
    )


def _true_object(row: dict[str, Any]) -> TrueObject:
    mask = row.get("mask")
    shape = RunLengths(mask[0], (mask[1], mask[2]), (mask[3], mask[4])) if mask else None
    left, top, right, bottom = row["box"]
    box, is_pasted = (left, top, right, bottom), row.get("pasted", False)
    return TrueObject(row["category"], row["coarse"], row["subtype"], box, row["ignored"], shape, is_pasted)


def read_examples(paths: Sequence[Path], splits: tuple[str, ...] = SPLITS_USED) -> list[ExampleSet]:
    """The examples of folders with COCO files, and of packed files.

    Raises:
        PaveTwinError: one is not there, cannot be read, or has labels out of range.
    """
    found = []
    for path in paths:
        if not path.exists():
            raise PaveTwinError(f"There is no dataset '{path}'.")
        found.append(read_coco(path, splits) if path.is_dir() else read_pack(path, splits))
    return found
