"""Detections matched to true objects by the COCO protocol (Lin et al. 2014), with pycocotools.

In order of confidence, each detection of a class is matched to the free true object of that class with the greatest
overlap, at IoU thresholds from 0.50 to 0.95. A detection that matches only an ignored region is left out.
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
from pavetwin.labels.class_names import CLASS_LABELS, COARSE_LABELS, ROAD_DEFECT, SUBTYPE_LABELS
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledRegion

THRESHOLDS: Final = np.linspace(0.5, 0.95, 10)
HALF: Final = 0
"""Index of IoU 0.5 in `THRESHOLDS`."""

MOST_DETECTIONS: Final = 100  # Maximum detections of a class in an image; the most confident count


@dataclass(frozen=True, slots=True)
class MatchedClass:
    """Detections of one class, most confident first, and its true objects that are not ignored."""

    name: str
    average_precision: Float64Array
    """(thresholds,) in 0 … 1; NaN without a true object."""
    found: IndexArray
    """(n,) index of the detection."""
    image: IndexArray
    """(n,) index of the image."""
    confidence: Float64Array
    """(n,)"""
    hit: BoolArray
    """(thresholds, n) whether it matches a true object."""
    left_out: BoolArray
    """(thresholds, n) whether it matches only an ignored region."""
    true_image: IndexArray
    """(m,) index of the image of each true object."""
    true_number: IndexArray
    """(m,) number of its annotation."""
    true_confidence: Float64Array
    """(m,) confidence of the detection that matches it at IoU 0.5; NaN where missed."""
    true_found: IndexArray
    """(m,) index of that detection; −1 where missed."""

    @property
    def objects(self) -> int:
        return len(self.true_image)


@dataclass(frozen=True)
class Matched:
    """Detections of a split matched to its objects, by class."""

    images: tuple[LabelledImage, ...]
    found: tuple[FoundBox, ...]
    classes: tuple[MatchedClass, ...]

    def mean_precision(self, threshold: int | None = None) -> float:
        """Mean average precision over classes with objects, at one threshold or over all; NaN without objects."""
        values = np.array([each.average_precision for each in self.classes if each.objects])
        if not len(values):
            return float("nan")
        return float(values.mean() if threshold is None else values[:, threshold].mean())


def labelled_only(images: tuple[LabelledImage, ...], found: Sequence[FoundBox]) -> tuple[FoundBox, ...]:
    """Detections in these images, except those of classes that the image's source does not label."""
    known = {image.number: image.known for image in images}
    return tuple(each for each in found if each.coarse in known.get(each.image, frozenset()))


def match_five(images: tuple[LabelledImage, ...], found: tuple[FoundBox, ...]) -> Matched:
    """Match the five classes by final confidence. Defects of other classes are ignored regions of every subtype."""
    return _matched(images, found, CLASS_LABELS)


def match_coarse(images: tuple[LabelledImage, ...], found: tuple[FoundBox, ...]) -> Matched:
    """Match the three coarse classes by detection confidence."""
    return _matched(images, found, COARSE_LABELS)


def _matched(images: tuple[LabelledImage, ...], found: tuple[FoundBox, ...], names: tuple[str, ...]) -> Matched:
    is_coarse = names == COARSE_LABELS
    rows: list[dict[str, Any]] = []
    numbers: list[int] = []
    for place, image in enumerate(images):
        for region in image.regions:
            classes, is_ignored = _true_classes(region, is_coarse=is_coarse)
            for each in classes:
                rows.append(coco_row(len(rows) + 1, place, each, region.true.box, is_ignored=is_ignored))
                numbers.append(region.number)
    places = {image.number: place for place, image in enumerate(images)}
    results = []
    for at, box in enumerate(found):
        row = coco_row(at + 1, places[box.image], box.coarse if is_coarse else box.number_of_class, box.box)
        results.append({**row, "score": box.detection if is_coarse else box.confidence})
    judge = judged(rows, results, len(images), len(names))
    of = np.array(numbers, dtype=np.intp)
    return Matched(images, found, tuple(_of_class(judge, at, name, of, len(images)) for at, name in enumerate(names)))


def _true_classes(region: LabelledRegion, *, is_coarse: bool) -> tuple[Sequence[int], bool]:
    """Classes to which a region belongs, and whether it is ignored there."""
    if is_coarse:
        return (region.true.coarse,), region.true.is_ignored
    if (number := region.number_of_class) is not None:
        return (number,), region.true.is_ignored
    assert region.true.coarse == ROAD_DEFECT
    return range(len(SUBTYPE_LABELS)), True


def coco_row(
    number: int, image: int, category: int, box: Sequence[float], *, is_ignored: bool = False
) -> dict[str, Any]:
    """Annotation as pycocotools takes it.

    Args:
        box: left, top, right, bottom.
    """
    left, top, right, bottom = box
    return {
        "id": number,
        "image_id": image,
        "category_id": category,
        "bbox": [left, top, right - left, bottom - top],
        "area": (right - left) * (bottom - top),
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


def judged(truth: list[dict[str, Any]], found: list[dict[str, Any]], images: int, classes: int) -> Any:
    """Evaluated `COCOeval` of annotations and scored detections made by `coco_row`.

    Raises:
        PaveTwinError: pycocotools is not installed.
    """
    check_installed()
    coco, evaluation = import_module("pycocotools.coco"), import_module("pycocotools.cocoeval")
    with contextlib.redirect_stdout(io.StringIO()):
        labels, results = coco.COCO(), coco.COCO()
        for holder, held in ((labels, truth), (results, found)):
            holder.dataset = {
                "images": [{"id": at} for at in range(images)],
                "annotations": held,
                "categories": [{"id": at} for at in range(classes)],
            }
            holder.createIndex()
        judge = evaluation.COCOeval(labels, results, "bbox")
        judge.params.iouThrs = THRESHOLDS
        judge.params.maxDets = [MOST_DETECTIONS]
        judge.params.areaRng, judge.params.areaRngLbl = [[0, float("inf")]], ["all"]
        judge.evaluate()
        judge.accumulate()
    return judge


def precision_of(judge: Any) -> Float64Array:
    """(thresholds, classes) average precision; NaN for a class without objects."""
    precision = judge.eval["precision"][:, :, :, 0, 0].mean(axis=1)
    return np.asarray(np.where(precision < 0, np.nan, precision), dtype=np.float64)


def _of_class(judge: Any, number: int, name: str, numbers: IndexArray, images: int) -> MatchedClass:
    # Results of each image; pycocotools gives None for images without detections and objects of the class.
    held = [each for each in judge.evalImgs[number * images : (number + 1) * images] if each is not None]
    scores = _joined([each["dtScores"] for each in held], np.float64)
    order = np.argsort(-scores, kind="mergesort")
    hits = [(each["dtMatches"] > 0) & ~each["dtIgnore"].astype(bool) for each in held]
    out = [each["dtIgnore"].astype(bool) for each in held]
    found = _joined([each["dtIds"] for each in held], np.intp) - 1
    counts = ~_joined([each["gtIgnore"] for each in held], np.bool_)
    matches = _joined([each["gtMatches"][HALF] for each in held], np.intp)[counts] - 1
    confidence = dict(zip(found.tolist(), scores.tolist(), strict=True))
    return MatchedClass(
        name=name,
        average_precision=precision_of(judge)[:, number],
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
