"""Detections of an evaluation: read from a file of COCO results, or made by a detector on the images of a dataset."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from math import isfinite, nan
from pathlib import Path
from typing import Any, Final, Protocol

from PIL import Image

from pavetwin.detections import NOT_RESOLVABLE, SIZES, Detections, possible_severities
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.class_names import NO_SUBTYPE, ROAD_DEFECT, class_of, coarse_of_classes
from pavetwin.perception.images import ImageLike
from pavetwin.perception.measuring import stated_sizes, with_sizes
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledSplit

_ROUNDING: Final = 2e-3
"""Tolerance between `score` and the product of its parts, which are often rounded to three digits."""


@dataclass(frozen=True, slots=True)
class FoundBox:
    """One detection."""

    image: int
    """Number of the image in the dataset."""
    coarse: int
    """Index into `COARSE`."""
    number_of_class: int
    """Index into `CLASSES`."""
    box: FloatBox
    """Left, top, right, bottom in pixels of the image."""
    detection: float
    """Confidence in the coarse class, 0 … 1; the final one if the file has only that."""
    confidence: float
    """The final one, 0 … 1."""
    sizes: Mapping[str, float] = field(default_factory=dict)
    """Measured sizes, by their names in `SIZES`."""
    severity: str = ""
    """Stated severity, see `visible_severity`; empty if none."""


def read_detections(path: Path, splits: tuple[LabelledSplit, ...]) -> tuple[FoundBox, ...]:
    """Detections of a file in COCO's format of results.

    An entry is `{"image_id": 1, "category_id": 3, "bbox": [left, top, width, height], "score": 0.81, "attributes":
    {"det_conf": 0.9, "cls_conf": 0.9}}`, with the numbers of the dataset's own files. The final confidence is detection
    × subtype confidence for defects, and the detection confidence for persons and cars. `score` alone is taken as the
    final one.

    Args:
        splits: of the dataset; an image that is in none of them is refused.

    Raises:
        PaveTwinError: the file is not as described; the message names the entry.
    """
    rows = _list(path)
    images = {image.number for split in splits for image in split.images}
    categories = {number: kind for split in splits for number, kind in split.categories.items()}
    found = []
    for at, row in enumerate(rows, start=1):
        where = f"'{path}': entry {at}"
        image = _number(row, "image_id", where)
        if image not in images:
            there = " and ".join(split.name for split in splits)
            raise PaveTwinError(f"{where} is of image {image:g}, which is not in {there} of the dataset.")
        found.append(_found(row, int(image), where, categories))
    return tuple(found)


def read_subtypes(path: Path, split: LabelledSplit) -> dict[int, int]:
    """Subtypes reported for true regions: number of the annotation → index into `SUBTYPES`.

    The file is a list of `{"annotation_id": 70001, "category_id": 3}`. Each defect of the split that counts is in it.

    Raises:
        PaveTwinError: the file is not as described, or a defect of the split is missing.
    """
    asked = {region.number for image in split.images for region in image.regions if region.has_subtype}
    every = {region.number for image in split.images for region in image.regions}
    reported: dict[int, int] = {}
    for at, row in enumerate(_list(path), start=1):
        where = f"'{path}': entry {at}"
        number = _number(row, "annotation_id", where)
        if number not in every:
            raise PaveTwinError(f"{where} is about annotation {number:g}, which the split {split.name} does not have.")
        coarse, subtype = _kind(row, where, split.categories)
        if coarse != ROAD_DEFECT:
            raise PaveTwinError(f"{where} has a category that is not a subtype of defects.")
        reported[int(number)] = subtype
    if missing := sorted(asked - reported.keys()):
        raise PaveTwinError(f"'{path}' has no entry for {len(missing)} of {len(asked)} defects, such as {missing[0]}.")
    return {number: reported[number] for number in asked}


def _list(path: Path) -> list[Any]:
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise PaveTwinError(f"'{path}' cannot be read ({error.strerror}).") from error
    except ValueError as error:
        raise PaveTwinError(f"'{path}' cannot be read as JSON ({error}).") from error
    if not isinstance(content, list):
        raise PaveTwinError(f"'{path}' is not a list of detections in COCO's form of results.")
    return content


def _found(row: Any, image: int, where: str, categories: Mapping[int, tuple[int, int]]) -> FoundBox:
    coarse, subtype = _kind(row, where, categories)
    number = class_of(coarse, subtype)
    assert number is not None
    detection, confidence = _confidences(row, coarse, where)
    attributes = row.get("attributes") or {}
    sizes = {
        name: _positive(attributes, name, where) for name in SIZES if attributes.get(name) not in (None, NOT_RESOLVABLE)
    }
    severity = attributes.get("severity") or ""
    if severity and (not isinstance(severity, str) or possible_severities(severity) is None):
        raise PaveTwinError(
            f"{where} has a severity '{severity}'; it is low, medium, high, low to medium or medium to high."
        )
    return FoundBox(image, coarse, number, _box(row, where), detection, confidence, sizes, severity)


def _kind(row: Any, where: str, categories: Mapping[int, tuple[int, int]]) -> tuple[int, int]:
    number = _number(row, "category_id", where)
    if number not in categories:
        raise PaveTwinError(f"{where} has category {number:g}, which the dataset does not have.")
    coarse, subtype = categories[int(number)]
    if coarse == ROAD_DEFECT and subtype == NO_SUBTYPE:
        raise PaveTwinError(f"{where} has category {number:g}, which is not one of the detector's five classes.")
    return coarse, subtype


def _confidences(row: Any, coarse: int, where: str) -> tuple[float, float]:
    """Detection confidence and final confidence."""
    attributes = row.get("attributes") or {}
    if not isinstance(attributes, dict):
        raise PaveTwinError(f"{where} has `attributes` that are not a mapping.")
    score = _share(row, "score", where) if "score" in row else None
    if "det_conf" not in attributes:
        if score is None:
            raise PaveTwinError(f"{where} has neither `score` nor the attribute `det_conf`.")
        return score, score
    detection = final = _share(attributes, "det_conf", where)
    if coarse == ROAD_DEFECT:
        if "cls_conf" not in attributes:
            raise PaveTwinError(f"{where} is of a defect and has no attribute `cls_conf` with its `det_conf`.")
        final = detection * _share(attributes, "cls_conf", where)
    if score is not None and abs(score - final) > _ROUNDING:
        raise PaveTwinError(f"{where} has the score {score:g}, and its parts make {final:.3g}.")
    return detection, final


def _box(row: Any, where: str) -> FloatBox:
    values = row.get("bbox")
    if not isinstance(values, list) or len(values) != 4:
        raise PaveTwinError(f"{where} has no `bbox` of left, top, width and height.")
    if not all(isinstance(value, int | float) and isfinite(value) for value in values):
        raise PaveTwinError(f"{where} has a `bbox` that is not of finite numbers.")
    left, top, width, height = map(float, values)
    if width < 0 or height < 0:
        raise PaveTwinError(f"{where} has a `bbox` of negative width or height.")
    return left, top, left + width, top + height


def _share(row: Mapping[str, Any], key: str, where: str) -> float:
    value = _number(row, key, where)
    if not 0.0 <= value <= 1.0:
        raise PaveTwinError(f"{where} has `{key}` {value:g}, which is not within 0 and 1.")
    return value


def _positive(row: Mapping[str, Any], key: str, where: str) -> float:
    value = _number(row, key, where)
    if value <= 0.0:
        raise PaveTwinError(f"{where} has `{key}` {value:g}, which is not above 0.")
    return value


def _number(row: Any, key: str, where: str) -> float:
    if not isinstance(row, dict):
        raise PaveTwinError(f"{where} is not a mapping.")
    value = row.get(key)
    if not isinstance(value, int | float) or isinstance(value, bool) or not isfinite(value):
        raise PaveTwinError(f"{where} has no finite number as `{key}`.")
    return float(value)


LEAST_CONFIDENCE: Final = 0.001
"""Confidence limit of an evaluated detector: average precision reads the whole curve."""


class Detects(Protocol):
    """A detector of objects in images."""

    def detect(self, images: Iterable[ImageLike]) -> list[Detections]:
        """The detections of each image."""


def found_by(
    detector: Detects, splits: Sequence[LabelledSplit], on_progress: Callable[[float], None] | None = None
) -> tuple[FoundBox, ...]:
    """The detections in all images of some splits of a dataset.

    Raises:
        PaveTwinError: a picture is missing, or no image.
    """
    images = [(split, image) for split in splits for image in split.images]
    found: list[FoundBox] = []
    for at, (split, image) in enumerate(images):
        found += _found_in(detector, split, image)
        if on_progress is not None:
            on_progress((at + 1) / len(images))
    return tuple(found)


class AsksRegions(Protocol):
    """A classifier of given regions."""

    def subtypes_at(self, image: ImageLike, boxes: Sequence[FloatBox]) -> list[int]:
        """The number in `SUBTYPES` of each region of an image."""


def subtypes_by(detector: AsksRegions, split: LabelledSplit) -> dict[int, int]:
    """Subtypes of the true boxes of defects: number of the annotation → index into `SUBTYPES`.

    Raises:
        PaveTwinError: a picture is missing, or no image.
    """
    subtypes: dict[int, int] = {}
    for image in split.images:
        regions = [each for each in image.regions if each.has_subtype]
        if regions:
            reported = detector.subtypes_at(_picture(split, image), [each.true.box for each in regions])
            subtypes |= zip((each.number for each in regions), reported, strict=True)
    return subtypes


def _picture(split: LabelledSplit, image: LabelledImage) -> Image.Image:
    try:
        picture = Image.open(BytesIO(split.data.encoded(image.example)))
        picture.load()
    except OSError as error:
        raise PaveTwinError(f"The picture of '{image.example.name}' cannot be read as an image ({error}).") from error
    return picture


def _found_in(detector: Detects, split: LabelledSplit, image: LabelledImage) -> list[FoundBox]:
    (detected,) = detector.detect([_picture(split, image)])
    detected = with_sizes(detected, image.facts.get("gsd_mm", image.example.gsd_mm or nan) or nan)
    numbers = detected.class_number
    coarse = coarse_of_classes(numbers)
    rows = []
    for row in range(len(detected)):
        stated = stated_sizes(detected, row)
        sizes = {name: value for name, value in stated.items() if not isinstance(value, str) and value > 0}
        detection = float(detected.detection_confidence[row])
        rows.append(
            FoundBox(
                image.number,
                int(coarse[row]),
                int(numbers[row]),
                detected.box(row),
                detection,
                detection * float(detected.subtype_confidence[row]),
                sizes,
                str(stated.get("severity", "")),
            )
        )
    return rows
