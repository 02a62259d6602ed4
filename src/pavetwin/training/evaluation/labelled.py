"""Labels of a dataset for evaluation, with the image numbers that detections use, and the known properties of each
image and object.

Read from COCO files as `pavetwin capture` and `pavetwin data export` write them.
"""

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite, pi, sqrt
from pathlib import Path
from typing import Any, Final

from pavetwin.labels.class_names import (
    COARSE,
    CRACKS,
    NO_SUBTYPE,
    ROAD_DEFECT,
    SUBTYPES,
    class_of,
    coarse_of,
    subtype_of,
)
from pavetwin.training.datasets.examples import Example, ExampleSet, TrueObject, labelled_classes, read_coco
from pavetwin.world.model import Severity

IMAGE_FACTS: Final = ("altitude_m", "gsd_mm", "sun_elevation_deg", "cloud_cover")
"""Facts of an image: height of the camera above the road, millimetres of the road that a pixel covers, the
sun's elevation, and the share of the sky with clouds."""

OBJECT_FACTS: Final = ("visible_fraction", "inside_fraction", "contrast", "area_m2", "length_m")
"""Facts of an object, see docs/explanation/labels.md. Sizes are those of defects. A single crack's mean width
follows from its area and length, and the diameter of others from their area."""

_SEVERITIES: Final = frozenset(each.value for each in Severity)


@dataclass(frozen=True, slots=True)
class LabelledRegion:
    """A labelled object of an image."""

    number: int
    """Number of the annotation in its file."""
    true: TrueObject
    facts: Mapping[str, float]
    """Known facts, by their names in `OBJECT_FACTS`."""
    severity: str = ""
    """Severity of a defect, a value of `Severity`; empty if unknown."""

    @property
    def number_of_class(self) -> int | None:
        """Index into `CLASSES`; None for a defect of a custom class."""
        return class_of(self.true.coarse, self.true.subtype)

    @property
    def has_subtype(self) -> bool:
        """True for a defect of a known subtype that is not ignored."""
        is_defect = self.true.coarse == ROAD_DEFECT and not self.true.is_ignored
        return is_defect and self.true.subtype != NO_SUBTYPE


@dataclass(frozen=True, slots=True)
class LabelledImage:
    """An image of a split, with or without objects."""

    number: int
    """Number by which detections refer to it."""
    example: Example
    group: str
    """Images of one group show one place, and are drawn together in a bootstrap."""
    known: frozenset[int]
    """Coarse classes that its source labels; of others it may show some without a label."""
    facts: Mapping[str, float]
    """Known facts, by their names in `IMAGE_FACTS`."""
    regions: tuple[LabelledRegion, ...]


@dataclass(frozen=True)
class LabelledSplit:
    """The images of one split of a dataset."""

    name: str
    data: ExampleSet
    categories: Mapping[int, tuple[int, int]]
    """Number of a class in the file → coarse class and subtype."""
    images: tuple[LabelledImage, ...]
    is_renumbered: bool = False
    """True if image numbers differ from those in the file, so that a file of detections cannot refer to them."""


def numbered_after(split: LabelledSplit, other: LabelledSplit) -> LabelledSplit:
    """The first split with other numbers of its images where it shares some with the other one.

    Numbers are unique within a file of annotations, and those of captures begin with 0 in each.
    """
    taken = {image.number for image in other.images}
    if taken.isdisjoint(image.number for image in split.images):
        return split
    start = max(taken) + 1
    images = tuple(replace(image, number=start + at) for at, image in enumerate(split.images))
    return replace(split, images=images, is_renumbered=True)


def read_split(folder: Path, split: str) -> LabelledSplit:
    """The labels of one split.

    Raises:
        PaveTwinError: there is no such file, or a label is not as COCO has it.
    """
    data = read_coco(folder, (split,))
    content = json.loads((folder / "annotations" / f"instances_{split}.json").read_bytes())
    rows: dict[int, list[dict[str, Any]]] = defaultdict(list)
    for row in content["annotations"]:
        rows[row["image_id"]].append(row)
    labelled = labelled_classes(data.examples)
    every = frozenset(range(len(COARSE)))
    images = []
    for image, example in zip(content["images"], data.examples, strict=True):
        pasted = {each.coarse for each in example.objects if each.is_pasted}
        known = every if example.is_synthetic else labelled.get(example.source, every) | pasted
        found = tuple(map(_region, rows.pop(image["id"], []), example.objects))
        group = str(image.get("group") or example.name)
        images.append(LabelledImage(int(image["id"]), example, group, known, _image_facts(image), found))
    return LabelledSplit(split, data, _categories(content["categories"]), tuple(images))


def _categories(rows: list[dict[str, Any]]) -> dict[int, tuple[int, int]]:
    found = {}
    for row in rows:
        coarse = coarse_of(row["name"], is_defect=row.get("supercategory") == "defect")
        if coarse is not None:
            found[int(row["id"])] = (coarse, subtype_of(row["name"]))
    return found


def _image_facts(image: dict[str, Any]) -> dict[str, float]:
    """Facts of an image, from camera and light of a capture, or from the attributes of other datasets."""
    given = {**_mapping(image, "attributes"), **_mapping(image, "camera"), **_mapping(image, "light")}
    return _numbers({**given, "gsd_mm": image.get("gsd_mm")}, IMAGE_FACTS)


def _region(row: dict[str, Any], true: TrueObject) -> LabelledRegion:
    known = {**_mapping(row, "attributes"), **row}
    facts = _numbers(known, OBJECT_FACTS)
    if true.coarse != ROAD_DEFECT:
        facts.pop("length_m", None)
        facts.pop("area_m2", None)
    elif "area_m2" in facts and facts["area_m2"] > 0:
        if true.subtype != SUBTYPES.index(CRACKS[0]):
            facts["diameter_mm"] = 2000 * sqrt(facts["area_m2"] / pi)
        elif facts.get("length_m", 0.0) > 0:
            facts["mean_width_mm"] = 1000 * facts["area_m2"] / facts["length_m"]
    severity = known.get("severity") if true.coarse == ROAD_DEFECT else None
    return LabelledRegion(int(row["id"]), true, facts, severity if severity in _SEVERITIES else "")


def _mapping(row: dict[str, Any], key: str) -> dict[str, Any]:
    held = row.get(key)
    return held if isinstance(held, dict) else {}


def _numbers(values: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, float]:
    """Finite numbers among these values; the common form of datasets has numbers as text."""
    found = {}
    for name in names:
        try:
            value = float(values[name])
        except (KeyError, TypeError, ValueError):
            continue
        if isfinite(value):
            found[name] = value
    return found
