"""Detections matched to true objects by the COCO protocol, with the published evaluation (pycocotools).

From the most confident on, each detection of a class is matched to the free true object of that class that it overlaps
most, at IoU thresholds from 0.50 to 0.95. One that matches nothing but an ignored region is left out. Of a class, the
100 most confident detections of an image count (Lin et al. 2014).
"""

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.errors import PaveTwinError
from pavetwin.perception.classes import CLASSES, COARSE, ROAD_DEFECT, SUBTYPES
from pavetwin.training.evaluation.average_precision import MOST_DETECTIONS, THRESHOLDS
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledRegion

HALF: Final = 0
"""The place of IoU 0.5 among the thresholds."""


@dataclass(frozen=True, slots=True)
class MatchedClass:
    """The detections of one class, from the most confident on, and its true objects that count."""

    name: str
    average_precision: Float64Array
    """(thresholds,) in 0 … 1; NaN without a true object."""
    found: IndexArray
    """(n,) which detection."""
    image: IndexArray
    """(n,) which image, by its place."""
    confidence: Float64Array
    """(n,)"""
    hit: BoolArray
    """(thresholds, n) it matches a true object that counts."""
    left_out: BoolArray
    """(thresholds, n) it matches an ignored region only."""
    true_image: IndexArray
    """(m,) image of each true object."""
    true_number: IndexArray
    """(m,) number of its annotation."""
    true_confidence: Float64Array
    """(m,) of the detection that matches it at IoU 0.5; NaN where none does."""
    true_found: IndexArray
    """(m,) which detection that is; -1 where none does."""

    @property
    def objects(self) -> int:
        return len(self.true_image)


@dataclass(frozen=True)
class Matched:
    """Detections of a split matched to its objects, class by class."""

    images: tuple[LabelledImage, ...]
    found: tuple[FoundBox, ...]
    classes: tuple[MatchedClass, ...]

    def mean_precision(self, threshold: int | None = None) -> float:
        """Mean average precision over classes that have objects: at one threshold, or over all; NaN without any."""
        values = np.array([each.average_precision for each in self.classes if each.objects])
        if not len(values):
            return float("nan")
        return float(values.mean() if threshold is None else values[:, threshold].mean())


def told_apart(images: tuple[LabelledImage, ...], found: Sequence[FoundBox]) -> tuple[FoundBox, ...]:
    """Detections in these images, without those of classes that are not labelled in their image's source."""
    known = {image.number: image.known for image in images}
    return tuple(each for each in found if each.coarse in known.get(each.image, frozenset()))


def match_five(images: tuple[LabelledImage, ...], found: tuple[FoundBox, ...]) -> Matched:
    """Over the five classes, with final confidences. Defects of other classes are ignored regions of every subtype."""
    return _matched(images, found, CLASSES)


def match_coarse(images: tuple[LabelledImage, ...], found: tuple[FoundBox, ...]) -> Matched:
    """Over the three coarse classes, with confidences of the detection."""
    return _matched(images, found, COARSE)


def _matched(images: tuple[LabelledImage, ...], found: tuple[FoundBox, ...], names: tuple[str, ...]) -> Matched:
    is_coarse = names == COARSE
    rows: list[dict[str, Any]] = []
    numbers: list[int] = []
    for place, image in enumerate(images):
        for region in image.regions:
            classes, is_ignored = _true_classes(region, is_coarse=is_coarse)
            for each in classes:
                left, top, right, bottom = region.true.box
                rows.append(_row(len(rows) + 1, place, each, (left, top, right - left, bottom - top), is_ignored))
                numbers.append(region.number)
    places = {image.number: place for place, image in enumerate(images)}
    said = []
    for at, box in enumerate(found):
        left, top, right, bottom = box.box
        each = box.coarse if is_coarse else box.number_of_class
        row = _row(at + 1, places[box.image], each, (left, top, right - left, bottom - top), False)
        said.append({**row, "score": box.detection if is_coarse else box.confidence})
    judge = _judged(rows, said, len(images), len(names))
    of = np.array(numbers, dtype=np.intp)
    return Matched(images, found, tuple(_of_class(judge, at, name, of, len(images)) for at, name in enumerate(names)))


def _true_classes(region: LabelledRegion, *, is_coarse: bool) -> tuple[Sequence[int], bool]:
    """The classes in which a region stands, and whether it is ignored there."""
    if is_coarse:
        return (region.true.coarse,), region.true.is_ignored
    if (number := region.number_of_class) is not None:
        return (number,), region.true.is_ignored
    assert region.true.coarse == ROAD_DEFECT
    return range(len(SUBTYPES)), True


def _row(number: int, image: int, category: int, box: tuple[float, ...], is_ignored: bool) -> dict[str, Any]:
    return {
        "id": number,
        "image_id": image,
        "category_id": category,
        "bbox": list(box),
        "area": box[2] * box[3],
        "iscrowd": int(is_ignored),
    }


def check_installed() -> None:
    """Raises:
    PaveTwinError: pycocotools is not installed.
    """
    if find_spec("pycocotools") is None:
        raise PaveTwinError(
            "An evaluation needs pycocotools, which is not installed; get it with `pip install 'pavetwin[evaluate]'`."
        )


def _judged(rows: list[dict[str, Any]], said: list[dict[str, Any]], images: int, classes: int) -> Any:
    check_installed()
    coco, evaluation = import_module("pycocotools.coco"), import_module("pycocotools.cocoeval")
    with contextlib.redirect_stdout(io.StringIO()):
        truth, results = coco.COCO(), coco.COCO()
        for holder, held in ((truth, rows), (results, said)):
            holder.dataset = {
                "images": [{"id": at} for at in range(images)],
                "annotations": held,
                "categories": [{"id": at} for at in range(classes)],
            }
            holder.createIndex()
        judge = evaluation.COCOeval(truth, results, "bbox")
        judge.params.iouThrs = THRESHOLDS
        judge.params.maxDets = [MOST_DETECTIONS]
        judge.params.areaRng, judge.params.areaRngLbl = [[0, float("inf")]], ["all"]
        judge.evaluate()
        judge.accumulate()
    return judge


def _of_class(judge: Any, number: int, name: str, numbers: IndexArray, images: int) -> MatchedClass:
    # Of each image what pycocotools says, or None where it has neither a detection nor an object of the class.
    held = [each for each in judge.evalImgs[number * images : (number + 1) * images] if each is not None]
    scores = _joined([each["dtScores"] for each in held], np.float64)
    order = np.argsort(-scores, kind="mergesort")
    hits = [(each["dtMatches"] > 0) & ~each["dtIgnore"].astype(bool) for each in held]
    out = [each["dtIgnore"].astype(bool) for each in held]
    found = _joined([each["dtIds"] for each in held], np.intp) - 1
    counts = ~_joined([each["gtIgnore"] for each in held], np.bool_)
    matches = _joined([each["gtMatches"][HALF] for each in held], np.intp)[counts] - 1
    confidence = dict(zip(found.tolist(), scores.tolist(), strict=True))
    precision = judge.eval["precision"][:, :, number, 0, 0].mean(axis=1)
    return MatchedClass(
        name=name,
        average_precision=np.where(precision < 0, np.nan, precision),
        found=found[order],
        image=_repeated(held, "dtIds")[order],
        confidence=scores[order],
        hit=_beside(hits)[:, order],
        left_out=_beside(out)[:, order],
        true_image=_repeated(held, "gtIds")[counts],
        true_number=numbers[_joined([each["gtIds"] for each in held], np.intp)[counts] - 1],
        true_confidence=np.array([confidence.get(at, np.nan) for at in matches.tolist()], dtype=np.float64),
        true_found=matches,
    )


def _joined(parts: list[Any], kind: Any) -> Any:
    return np.concatenate([np.asarray(part, dtype=kind) for part in parts]) if parts else np.empty(0, dtype=kind)


def _beside(parts: list[BoolArray]) -> BoolArray:
    return np.hstack(parts) if parts else np.empty((len(THRESHOLDS), 0), dtype=np.bool_)


def _repeated(held: list[dict[str, Any]], key: str) -> IndexArray:
    """The image of each entry of a key."""
    return np.repeat(
        np.array([each["image_id"] for each in held], dtype=np.intp),
        np.array([len(each[key]) for each in held], dtype=np.intp),
    )
