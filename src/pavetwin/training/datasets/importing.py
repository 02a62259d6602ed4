"""Import of a source's files into a dataset of the common form: read, convert, resize and write, image by image.

Pictures are decoded and encoded in threads, a few at a time and in order: memory does not grow with the number of
images, and a repeated run gives the same bytes. Existing images are not made again.

Boxes follow these rules, in this order:

1. Swapped corners are put in order (repaired).
2. The part outside the image is cut off, and reported from half a pixel on (repaired).
3. A box without area, or wholly outside, is left out (dropped).
4. A second box of the same class and place is left out (dropped).

An image with a label that cannot be understood is refused as a whole: without the label, its object would count as
background.
"""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import chain
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import Final

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import PICTURE_SUFFIXES, staging_folder, working_in
from pavetwin.labels.boxes import FloatBox, PixelBox, area, ordered, scaled, to_pixels, within
from pavetwin.labels.common_form import AnnotatedImage, Annotation, Polygon, annotation_path, as_xml, write_description
from pavetwin.labels.voc import ANNOTATIONS, PICTURES
from pavetwin.training.datasets.layouts.layout import SWAPPED, RawImage, RawObject
from pavetwin.training.datasets.pictures import PictureError, files_in, picture_size
from pavetwin.training.datasets.report import FILE as REPORT
from pavetwin.training.datasets.report import UNLABELLED, Finding, Report
from pavetwin.training.datasets.resizing import ImageSize, ImageView, encoded_views, kept_as_it_is, seen_through, views
from pavetwin.training.datasets.resuming import check_same, fingerprint, made_ahead, move_in
from pavetwin.training.datasets.sources import DatasetSource
from pavetwin.training.datasets.sources.registry import DISCARD, DROP, IGNORE, outcome, unknown_class

ROUNDING_PX: Final = 0.5  # So far a box may reach beyond the image unreported: shares with six digits are not exact

EMPTY: Final = "a box without area is left out"
OUTSIDE: Final = "a box outside the image is left out"
CUT: Final = "a box reached beyond the image; cut off at its border"
TWICE: Final = "the same box of the same class is given twice; kept once"


def convert(
    raw: RawImage,
    source: DatasetSource,
    size_px: tuple[int, int],
    report: Report,
    *,
    source_name: str,
    name: str,
    suffix: str,
    is_background: bool = False,
) -> AnnotatedImage | None:
    """The image in the common form, at its own size; None, and a line in the report, where it is left out.

    Args:
        size_px: width and height of the picture.
        is_background: someone has checked that it shows nothing of any class.
    """
    if raw.size_px is not None and sorted(raw.size_px) != sorted(size_px):
        made_for, found = ("{} × {}".format(*each) for each in (raw.size_px, size_px))
        words = f"the labels are for {made_for} pixels, the picture has {found}; the image is left out"
        report.add(Finding.REFUSED, raw.labels, words, raw.line)
        return None
    annotations: list[Annotation] = []
    known: set[tuple[str | None, PixelBox]] = set()
    has_lost = False
    for each in raw.objects:
        becomes = outcome(source.classes, each.label)
        if becomes is None:
            words = f"{unknown_class(source.classes, each.label)}; the image is left out"
            report.add(Finding.REFUSED, raw.labels, words, each.line, alike=f"class {each.label}")
            return None
        if becomes == DISCARD:
            words = f"images with a '{each.label}' are left out"
            report.add(Finding.DROPPED, raw.labels, words, each.line, alike=f"discard {each.label}")
            return None
        if becomes == DROP:
            continue
        if not all(map(isfinite, chain.from_iterable(each.outline or ()))):
            words = "a corner of an outline is not finite; the image is left out"
            report.add(Finding.REFUSED, raw.labels, words, each.line)
            return None
        annotation = _annotation(each, becomes, raw, size_px, report)
        if annotation is None:
            has_lost = True
            continue
        if (annotation.category, annotation.box) in known:
            report.add(Finding.DROPPED, raw.labels, TWICE, each.line)
            continue
        known.add((annotation.category, annotation.box))
        annotations.append(annotation)
    has_labels = any(each.ignored is None for each in annotations)
    if is_background and has_labels:
        report.add(Finding.REFUSED, raw.labels, "listed as background, and has labels; the image is left out", raw.line)
        return None
    if not has_labels and not is_background:
        words = "no valid box, and not listed as verified background; the image is left out"
        report.add(Finding.DROPPED, raw.labels, words, alike="no valid box")
        # What is ignored may be damage of a class that is not learned, and what had no valid box was something too.
        if not annotations and not has_lost:
            report.unlabelled.append(raw.original)
        return None
    return AnnotatedImage(
        name=name,
        suffix=suffix,
        size_px=size_px,
        source=source_name,
        original=raw.original,
        group=f"{source_name}:{raw.group or source.group_of(raw.original)}",
        gsd_mm=raw.gsd_mm or source.gsd_mm,
        is_background=is_background,
        annotations=tuple(annotations),
        attributes=raw.attributes,
    )


def _annotation(
    raw: RawObject, becomes: str, image: RawImage, size_px: tuple[int, int], report: Report
) -> Annotation | None:
    width, height = size_px
    across, down = size_px if image.is_normalised else (1, 1)
    box = scaled(raw.box, across, down)
    if not all(map(isfinite, box)):
        report.add(Finding.DROPPED, image.labels, OUTSIDE, raw.line)
        return None
    if box[0] > box[2] or box[1] > box[3]:
        report.add(Finding.REPAIRED, image.labels, SWAPPED, raw.line)
        box = ordered(box)
    if not area(box):
        report.add(Finding.DROPPED, image.labels, EMPTY, raw.line)
        return None
    inside = within(box, (0, 0, width, height))
    pixels = to_pixels(box, size_px)
    if inside is None or pixels is None:
        report.add(Finding.DROPPED, image.labels, OUTSIDE, raw.line)
        return None
    if max(_beyond(box, inside)) > ROUNDING_PX:
        report.add(Finding.REPAIRED, image.labels, CUT, raw.line)
    ignored = f"class '{raw.label}'" if becomes == IGNORE else raw.ignored
    return Annotation(
        category=None if becomes == IGNORE else becomes,
        box=pixels,
        ignored=ignored,
        outline=_outline(raw.outline, size_px, (across, down)),
        original=raw.label,
        attributes=raw.attributes,
    )


def _beyond(box: FloatBox, inside: FloatBox) -> Iterator[float]:
    """Distance that each edge was moved."""
    return (abs(edge - other) for edge, other in zip(box, inside, strict=True))


def _outline(outline: Polygon | None, size_px: tuple[int, int], factors: tuple[int, int]) -> Polygon | None:
    if outline is None:
        return None
    (width, height), (across, down) = size_px, factors
    return tuple((min(max(x * across, 0.0), width), min(max(y * down, 0.0), height)) for x, y in outline)


LONGEST_NAME: Final = 100
"""Characters of an image's name: file systems allow 255 bytes, and composites and copies add to it."""


OnImage = Callable[[int, int], None]
"""Called with the number of images read, and of all pictures."""


@dataclass(frozen=True)
class ImportSummary:
    """Result of an import."""

    folder: Path
    images: int
    report: Report

    def refuse_empty(self) -> None:
        """Raises:
        PaveTwinError: no image is in it; the message names the first finding.
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
    """Pending work in order; everything else goes into the report."""
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
    """Name of an image's files: the source and the picture's name, with its folders if others have the same name."""
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
