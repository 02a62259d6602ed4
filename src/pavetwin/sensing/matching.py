"""Which defect a detection means. One set of rules for every sensor (docs/explanation/definitions.md, "Matching").

A detection matches a defect of its own class when the intersection over union (IoU) of their image boxes is at least
0.5. Boxes of thin defects (classes registered with `is_thin`) overlap badly when one is shifted by a few pixels: for
them 0.3 is enough, or that the two share at least half of the shorter one's extent along the defect, at most `ASIDE_M`
apart. In the order of falling
confidence each detection takes the defect with the greatest IoU that no other has taken.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Box, Frame
from pavetwin.sensing.resolution import is_thin
from pavetwin.world.model import Defect

LEAST_IOU: Final = 0.5
LEAST_IOU_THIN: Final = 0.3
LEAST_EXTENT_THIN: Final = 0.5
"""Of the shorter of the two extents along a crack."""

ASIDE_M: Final = 0.1
"""A detection further from a crack than this means another one."""


class Shape(NamedTuple):
    """Something in an image: a detection, or a defect that is there."""

    kind: str
    box_px: Callable[[], Box]
    ground: Callable[[], Polygon]
    """On the ground, in metres."""
    confidence: float = 1.0


def match(frame: Frame, detections: Sequence[Detection], defects: Sequence[Defect]) -> list[tuple[int | None, bool]]:
    """For each detection the index of its defect in `defects` (None for none), and whether it is the first that means
    it in this frame.

    Args:
        defects: those that the frame can show, whole or in part.
    """
    found: list[tuple[int | None, bool]] = [(None, False)] * len(detections)
    some = [at for at, each in enumerate(detections) if not each.means_nothing]
    if not some:
        return found
    outlines = {(id(defect.polygon), defect.kind): index for index, defect in enumerate(defects)}
    reported = [detections[at] for at in some]
    # Sensors without images report outlines as they are: nothing needs a shape then.
    meant = [outlines.get((id(each.footprint), each.kind)) for each in reported]
    there = (
        [Shape(each.kind, partial(frame.box_of, each.polygon), partial(_outline, each)) for each in defects]
        if None in meant
        else []
    )

    def scores(index: int) -> dict[int, float]:
        each = reported[index]
        return _scores(Shape(each.kind, partial(each.box, frame), partial(each.ground, frame)), there)

    for at, matched in zip(some, _assigned([each.confidence for each in reported], meant, scores), strict=True):
        found[at] = matched
    return found


def _outline(defect: Defect) -> Polygon:
    return defect.polygon


def match_shapes(reported: Sequence[Shape], there: Sequence[Shape]) -> list[tuple[int | None, bool]]:
    """The same, for shapes in one image, whatever their places are measured in."""
    confidences = [each.confidence for each in reported]
    return _assigned(confidences, [None] * len(reported), lambda index: _scores(reported[index], there))


def _assigned(
    confidences: Sequence[float], meant: Sequence[int | None], scores: Callable[[int], dict[int, float]]
) -> list[tuple[int | None, bool]]:
    """Each detection's defect, in the order of falling confidence.

    Args:
        meant: for each detection the index of its defect, where it is known.
        scores: those of a detection, by its index, where it is not.
    """
    found: list[tuple[int | None, bool]] = [(None, False)] * len(confidences)
    taken: set[int] = set()
    for index in sorted(range(len(confidences)), key=lambda index: -confidences[index]):
        best = meant[index]
        if best is None:
            scored = scores(index)
            free = {defect: score for defect, score in scored.items() if defect not in taken}
            best = _best(free or scored)
        if best is not None:
            found[index] = (best, best not in taken)
            taken.add(best)
    return found


def _scores(detection: Shape, defects: Sequence[Shape]) -> dict[int, float]:
    """IoU of every defect that the detection may mean, by its index."""
    scores: dict[int, float] = {}
    thin = is_thin(detection.kind)
    for index, defect in enumerate(defects):
        if defect.kind != detection.kind:
            continue
        score = iou(detection.box_px(), defect.box_px())
        if score >= (LEAST_IOU_THIN if thin else LEAST_IOU) or (
            thin and shared_extent(detection.ground(), defect.ground()) >= LEAST_EXTENT_THIN
        ):
            scores[index] = score
    return scores


def _best(scores: dict[int, float]) -> int | None:
    """The defect with the greatest IoU, of equal ones the first."""
    return min(scores, key=lambda defect: (-scores[defect], defect), default=None)


def iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes; 0 where both are empty."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    shared = max(width, 0.0) * max(height, 0.0)
    together = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - shared
    return shared / together if together > 0 else 0.0


def shared_extent(footprint: Polygon, crack: Polygon) -> float:
    """How much of the shorter of two extents along a crack the two share, 0 … 1; 0 where they lie apart."""
    if shapely.distance(footprint, crack) > ASIDE_M:
        return 0.0
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(crack))
    if len(corners) < 4:
        return 0.0
    sides = np.diff(corners[:3], axis=0)
    along = sides[int(np.argmax(np.hypot(*sides.T)))]
    along = along / np.hypot(*along)
    low_a, high_a = _extent(footprint, along)
    low_b, high_b = _extent(crack, along)
    shorter = min(high_a - low_a, high_b - low_b)
    shared = min(high_a, high_b) - max(low_a, low_b)
    return max(shared, 0.0) / shorter if shorter > 0 else 0.0


def _extent(shape: Polygon, along: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    places = shapely.get_coordinates(shape) @ along
    return float(places.min()), float(places.max())
