"""A source's files into a dataset of the common form: read, converted, brought to size and written, image by image.

Pictures are decoded and encoded in threads, a few at a time and in order, so that memory does not grow with the number
of images and a run that is repeated gives the same bytes. Images that exist are not made again.
"""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from hashlib import file_digest, sha256
from pathlib import Path, PurePosixPath
from typing import Any, Final

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import PICTURE_SUFFIXES, staging_folder, working_in
from pavetwin.training.datasets.ahead import made_ahead
from pavetwin.training.datasets.annotated import AnnotatedImage
from pavetwin.training.datasets.common_form import (
    ANNOTATIONS,
    DESCRIPTION,
    PICTURES,
    annotation_path,
    as_xml,
    read_description,
    write_description,
)
from pavetwin.training.datasets.convert import convert
from pavetwin.training.datasets.layouts.base import RawImage
from pavetwin.training.datasets.normalise import ImageSize, ImageView, encoded_views, kept_as_it_is, seen_through, views
from pavetwin.training.datasets.pictures import PictureError, files_in, picture_size
from pavetwin.training.datasets.report import FILE as REPORT
from pavetwin.training.datasets.report import UNLABELLED, Finding, Report
from pavetwin.training.datasets.sources import DatasetSource

LONGEST_NAME: Final = 100
"""Characters of an image's name: file systems allow 255 bytes, and composites and copies add to it."""

_LABEL_SUFFIXES: Final = frozenset({".xml", ".txt", ".json", ".yaml", ".yml", ".csv"})

OnImage = Callable[[int, int], None]
"""Told the number of images looked at, and of all pictures."""


@dataclass(frozen=True)
class ImportSummary:
    """What an import left."""

    folder: Path
    images: int
    report: Report

    def refuse_empty(self) -> None:
        """Raises:
        PaveTwinError: no image is in it; the message says what was found first.
        """
        if self.images:
            return
        first = next(iter(self.report), None)
        found = f"{first}. All findings are in '{self.folder / REPORT}'" if first is not None else "no labels are there"
        raise PaveTwinError(f"No image was imported: {found}.")


@dataclass(frozen=True, slots=True)
class _Work:
    """A picture, and the images that it becomes."""

    raw: RawImage
    views: list[ImageView]
    images: list[AnnotatedImage]


def import_source(
    name: str,
    source: DatasetSource,
    folder: Path,
    output: Path,
    *,
    size: ImageSize,
    backgrounds: frozenset[str] = frozenset(),
    on_image: OnImage = lambda _done, _total: None,
) -> ImportSummary:
    """Import a source's folder; what an unfinished import made is kept and not made again.

    Args:
        name: of the source; the names of images begin with it.
        backgrounds: paths of pictures in the folder, with slashes, that someone has checked: they show nothing.

    Raises:
        PaveTwinError: the folder is not there or holds no picture, a listed background is not there, or the output
            holds another dataset or cannot be written.
    """
    if not folder.is_dir():
        raise PaveTwinError(f"There is no folder '{folder}'; give the one that the dataset was unpacked to.")
    report = Report()

    def on_closed(place: str, is_link: bool) -> None:
        if is_link:
            report.add(Finding.NOTE, place, "a link to another folder is not followed; what is in it is left out")
        else:
            report.add(Finding.REFUSED, place, "the folder cannot be read; what is in it is left out")

    pictures = files_in(folder, PICTURE_SUFFIXES, on_closed)
    if not pictures:
        raise PaveTwinError(f"'{folder}' holds no picture; give the folder that the dataset was unpacked to.")
    for path in sorted(backgrounds - set(pictures)):
        raise PaveTwinError(
            no_such("picture", path, pictures[:1000], key="`backgrounds`").partition("; known")[0] + "."
        )
    expected = {
        "made_by": "import",
        "source": name,
        "settings": {**source.model_dump(mode="json"), "size": size.model_dump(mode="json")},
        "backgrounds": sorted(backgrounds),
        "input": fingerprint(folder),
    }
    with working_in(output):
        check_same(output, expected)
        write_description(output, {**expected, "complete": False})
        for inner in (PICTURES, ANNOTATIONS):
            (output / inner).mkdir(exist_ok=True)
        found = _work(name, source, folder, size, backgrounds, report, pictures, on_image)
        with staging_folder(output / "staging") as staging:
            made = made_ahead(found, partial(_encode, size=size), exists=partial(_exists, output))
            images = sum(_write(each, output, staging, report) for each in made)
        report.save(output / REPORT)
        report.save_unlabelled(output / UNLABELLED)
        write_description(output, {**expected, "complete": True, "images": images})
    return ImportSummary(output, images, report)


def fingerprint(folder: Path) -> str:
    """SHA-256 of what a folder holds: the names and contents of pictures, masks and label files.

    With it, labels that were corrected and pictures that were exchanged are not taken for those imported before.
    """
    digest = sha256()
    for path in files_in(folder, PICTURE_SUFFIXES | _LABEL_SUFFIXES):
        file = folder / path
        try:
            with file.open("rb") as stream:
                told = file_digest(stream, "sha256").hexdigest()
        except OSError:
            told = "unreadable"
        digest.update(os.fsencode(f"{path}\0{told}\0"))
    return digest.hexdigest()


def check_same(output: Path, expected: dict[str, Any], name: str = DESCRIPTION) -> None:
    """Refuse a folder that holds something else than an earlier run of the same, as a file of this name tells.

    Raises:
        PaveTwinError: it does.
    """
    if output.exists() and not output.is_dir():
        raise PaveTwinError(f"'{output}' is a file; choose another folder.")
    if not (output / name).is_file():
        if output.is_dir() and any(output.iterdir()):
            raise PaveTwinError(f"'{output}' holds something else; choose another folder.")
        return
    found = read_description(output, name)
    differ = [key for key, value in expected.items() if found.get(key) != value]
    if differ:
        raise PaveTwinError(f"'{output}' holds a dataset made with another {differ[0]}; choose another folder.")


def _work(
    name: str,
    source: DatasetSource,
    folder: Path,
    size: ImageSize,
    backgrounds: frozenset[str],
    report: Report,
    pictures: list[str],
    on_image: OnImage,
) -> Iterator[_Work]:
    """What is to be made, in order; the rest is told to the report."""
    stems = Counter(_stem(path) for path in pictures)
    names = Counter(_name(name, path, stems).casefold() for path in pictures)
    taken: dict[str, str] = {}
    for done, raw in enumerate(source.labels.images(folder, report), start=1):
        on_image(done, len(pictures))
        try:
            size_px = picture_size(raw.picture)
        except PictureError as error:
            report.add(Finding.REFUSED, raw.original, f"{error}; the image is left out")
            continue
        image_name = _distinct(name, _name(name, raw.original, stems), raw.original, names)
        if (other := taken.get(image_name.casefold())) is not None:
            words = (
                "its labels are given twice" if other == raw.original else f"two files of one name, this and {other}"
            )
            report.add(Finding.REFUSED, raw.original, f"{words}; the second is left out")
            continue
        taken[image_name.casefold()] = raw.original
        image = convert(
            raw,
            source,
            size_px,
            report,
            source_name=name,
            name=image_name,
            suffix=".jpg",
            is_background=raw.is_background or raw.original in backgrounds,
        )
        if image is None:
            continue
        if size.target_gsd_mm is not None and image.gsd_mm is None:
            words = "its ground resolution is not known, so it is not scaled to the target"
            report.add(Finding.NOTE, raw.original, words, alike="no ground resolution")
        shown = views(image, size)
        suffix = raw.picture.suffix.lower() if len(shown) == 1 and kept_as_it_is(raw.picture, shown[0]) else ".jpg"
        made = [seen_through(image, view, suffix.replace("jpeg", "jpg")) for view in shown]
        kept = [at for at, each in enumerate(made) if each.labelled or each.is_background]
        if not kept:
            report.add(Finding.DROPPED, raw.original, "no label is left in any of its views; the image is left out")
        elif len(kept) < len(made):
            words = f"{len(made) - len(kept)} of its {len(made)} tiles show no label and are left out"
            report.add(Finding.NOTE, raw.original, words, alike="tiles without labels")
        if kept:
            yield _Work(raw, [shown[at] for at in kept], [made[at] for at in kept])


def _stem(path: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", PurePosixPath(path).stem).strip("-").casefold()


def _name(source: str, original: str, stems: Counter[str]) -> str:
    """Of an image's files: the source and the picture's name, with its folders where others have the same name."""
    path = PurePosixPath(original)
    parts = path.parts[:-1] if stems[_stem(original)] > 1 else ()
    words = (re.sub(r"[^A-Za-z0-9_-]+", "-", part).strip("-") for part in (*parts, path.stem))
    return "-".join(filter(None, (source, *words)))


def _distinct(source: str, name: str, original: str, names: Counter[str]) -> str:
    """The name; with a hash of the picture's path where others have the same, it is too long, or has no letter left."""
    if names[name.casefold()] < 2 and len(name) <= LONGEST_NAME and name != source:
        return name
    return f"{name[:LONGEST_NAME]}-{sha256(os.fsencode(original)).hexdigest()[:8]}"


def _exists(output: Path, work: _Work) -> bool:
    return all(annotation_path(output, image.name).is_file() for image in work.images)


def _encode(work: _Work, size: ImageSize) -> list[bytes]:
    return list(encoded_views(work.raw.picture, work.views, size.quality))


def _write(made: tuple[_Work, Future[list[bytes]] | None], output: Path, staging: Path, report: Report) -> int:
    """Write a picture's images, each with its XML file last. Returns how many are there now."""
    work, job = made
    if job is None:
        return len(work.images)
    try:
        contents = job.result()
    except PictureError as error:
        report.add(Finding.REFUSED, work.raw.original, f"{error}; the image is left out")
        return 0
    for image, content in zip(work.images, contents, strict=True):
        move_in(staging, output / PICTURES / image.picture, content)
        move_in(staging, annotation_path(output, image.name), as_xml(image))
    return len(work.images)


def move_in(staging: Path, target: Path, content: bytes) -> None:
    """Write a file whole or not at all: into a staging folder of the same disk, then moved."""
    (staging / target.name).write_bytes(content)
    (staging / target.name).replace(target)
