"""Matching of detections with defects, by one set of rules (docs/explanation/definitions.md, "Matching").

A detection matches a defect of its own class when the intersection over union (IoU) of their image boxes is at least
0.5. Boxes of thin defects (classes registered with `is_thin`) overlap badly when one is shifted by a few pixels: for
them 0.3 is enough, or that the two share at least half of the shorter one's extent along the defect, at most `ASIDE_M`
apart. In the order of falling confidence each detection takes the defect with the greatest IoU that no other has taken.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.detections import Detections
from pavetwin.sensing.frame import Frame
from pavetwin.sensing.resolution import is_thin
from pavetwin.world.model import Defect
from pavetwin.world.rectangles import smallest_rectangle

LEAST_IOU: Final = 0.5
LEAST_IOU_THIN: Final = 0.3
LEAST_EXTENT_THIN: Final = 0.5
"""Shared extent along a crack, as a share of the shorter of the two extents."""

ASIDE_M: Final = 0.1
"""Distance from a crack beyond which a detection means another one."""


class Matches(NamedTuple):
    """The defect of each detection."""

    defect: IndexArray
    """(n,) index of the defect; −1 for none."""
    is_first: BoolArray
    """(n,) whether it is the first detection of that defect, in the order of falling confidence."""


def match(frame: Frame, detections: Detections, defects: Sequence[Defect]) -> Matches:
    """Match the detections of a frame with defects; rows with `is_spurious` match none.

    Args:
        defects: those that the frame can show, whole or in part.
    """
    rows = np.flatnonzero(~detections.is_spurious)
    reported = detections[rows]
    outlines = {(id(defect.polygon), defect.kind): index for index, defect in enumerate(defects)}
    # Sensors without images report outlines as they are: these need no matching by shape.
    exact = np.array(
        [
            outlines.get((id(each), name), -1)
            for each, name in zip(reported.footprint, reported.class_name, strict=True)
        ],
        dtype=np.intp,
    )
    found = np.full(len(detections), -1, dtype=np.intp), np.zeros(len(detections), dtype=np.bool_)
    if (exact < 0).any():
        known = set(reported.class_name[exact < 0])
        there = [index for index, defect in enumerate(defects) if defect.kind in known]
        truth = placed(Detections.of_defects(defects[index] for index in there), frame)
        scores = _scores(placed(reported, frame), truth, np.array(there, dtype=np.intp))
        matched = _assigned(reported.confidence, exact, scores)
    else:
        matched = _assigned(reported.confidence, exact, lambda _: {})
    found[0][rows], found[1][rows] = matched
    return Matches(*found)


def match_shapes(reported: Detections, there: Detections) -> Matches:
    """Match detections with true objects in one image, each with `box_px` and `footprint` in any metric frame."""
    every = np.arange(len(there))
    return Matches(*_assigned(reported.confidence, np.full(len(reported), -1), _scores(reported, there, every)))


def placed(detections: Detections, frame: Frame) -> Detections:
    """Detections of a frame with both places: footprints on the ground, and boxes in the image."""
    footprints = list(detections.footprint)
    boxes = detections.box_px.copy()
    for row in range(len(detections)):
        if footprints[row] is None:
            footprints[row] = frame.footprint_of(detections.box(row))
        elif np.isnan(boxes[row, 0]):
            boxes[row] = frame.box_of(footprints[row])
    return detections.with_columns(footprint=footprints, box_px=boxes)


def _assigned(
    confidence: Float64Array, exact: IndexArray, scores: Callable[[int], dict[int, float]]
) -> tuple[IndexArray, BoolArray]:
    """The defect of each detection and whether it is its first, in the order of falling confidence.

    Args:
        exact: for each detection the index of the defect whose outline it is, or −1.
        scores: IoU of the defects that a detection may mean, for those of no exact outline.
    """
    defect, is_first = np.full(len(exact), -1, dtype=np.intp), np.zeros(len(exact), dtype=np.bool_)
    taken: set[int] = set()
    for row in np.argsort(-confidence, kind="stable").tolist():
        best = int(exact[row])
        if best < 0:
            scored = scores(row)
            free = {index: score for index, score in scored.items() if index not in taken}
            best = _best(free or scored)
        if best >= 0:
            defect[row], is_first[row] = best, best not in taken
            taken.add(best)
    return defect, is_first


def _scores(reported: Detections, there: Detections, indices: IndexArray) -> Callable[[int], dict[int, float]]:
    """A function from a row of `reported` to the IoU of the defects that it may mean, by their indices."""

    def scores(row: int) -> dict[int, float]:
        name = reported.class_name[row]
        thin = is_thin(name)
        least = LEAST_IOU_THIN if thin else LEAST_IOU
        same = np.flatnonzero(there.class_name == name)
        overlaps = iou(reported.box_px[row], there.box_px[same])
        return {
            int(indices[other]): float(overlap)
            for other, overlap in zip(same, overlaps, strict=True)
            if overlap >= least
            or (thin and shared_extent(reported.footprint[row], there.footprint[other]) >= LEAST_EXTENT_THIN)
        }

    return scores


def _best(scores: dict[int, float]) -> int:
    """The defect with the greatest IoU, the first of equal ones; −1 for none."""
    return min(scores, key=lambda defect: (-scores[defect], defect), default=-1)


def iou(box: Float64Array, boxes: Float64Array) -> Float64Array:
    """(n,) Intersection over union of a box (4,) with each of others (n, 4); 0 where both are empty."""
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    shared = np.maximum(high - low, 0.0).prod(axis=1)
    together = (box[2:] - box[:2]).prod() + (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) - shared
    shares: Float64Array = np.divide(shared, together, out=np.zeros_like(shared), where=together > 0)
    return shares


def shared_extent(footprint: Polygon, crack: Polygon) -> float:
    """Extent along a crack that two outlines share, as a share of the shorter extent, 0 … 1; 0 where they lie apart."""
    if shapely.distance(footprint, crack) > ASIDE_M:
        return 0.0
    around = smallest_rectangle(crack)
    if around is None:
        return 0.0
    low_a, high_a = _extent(footprint, around.along)
    low_b, high_b = _extent(crack, around.along)
    shorter = min(high_a - low_a, high_b - low_b)
    shared = min(high_a, high_b) - max(low_a, low_b)
    return max(shared, 0.0) / shorter if shorter > 0 else 0.0


def _extent(shape: Polygon, along: Float64Array) -> tuple[float, float]:
    places = shapely.get_coordinates(shape) @ along
    return float(places.min()), float(places.max())
