"""From a raw image to the common form: classes by rules, boxes repaired or left out by rules, all of it reported.

The rules for boxes, in this order:

1. Corners in the wrong order are put in order (repaired).
2. What lies outside the image is cut off; more than half a pixel is reported (repaired).
3. A box without area, or wholly outside, is left out (dropped).
4. The same box of the same class a second time is left out (dropped).

An image is refused whole where one of its labels cannot be understood: without it, what it labels would be background.
"""

from collections.abc import Iterator
from itertools import chain
from math import isfinite
from typing import Final

from pavetwin.labels.boxes import FloatBox, PixelBox, area, ordered, scaled, to_pixels, within
from pavetwin.training.datasets.annotated import AnnotatedImage, Annotation, Polygon
from pavetwin.training.datasets.layouts.base import SWAPPED, RawImage, RawObject
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.rules import DISCARD, DROP, IGNORE, outcome, unknown_class
from pavetwin.training.datasets.sources.base import DatasetSource

ROUNDING_PX: Final = 0.5
"""So far a box may reach beyond the image unreported: shares with six digits are not exact."""

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
    """How far each edge was moved."""
    return (abs(edge - other) for edge, other in zip(box, inside, strict=True))


def _outline(outline: Polygon | None, size_px: tuple[int, int], factors: tuple[int, int]) -> Polygon | None:
    if outline is None:
        return None
    (width, height), (across, down) = size_px, factors
    return tuple((min(max(x * across, 0.0), width), min(max(y * down, 0.0), height)) for x, y in outline)
