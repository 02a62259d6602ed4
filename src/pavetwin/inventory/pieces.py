"""Cracks in pieces: which detections go on in one another, and what an image shows in pieces as one look."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import cos, radians
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.inventory.observation import Observation, shared
from pavetwin.sensing.resolution import is_thin

ANGLE_DEG: Final = 15.0
"""Largest angle between two pieces of one crack."""

ASIDE_M: Final = 0.15
"""The end of a piece lies at most this far beside the line of the other."""

GAP_M: Final = 1.0
"""Longest part of a crack that is not detected between two pieces."""

SLENDER: Final = 2.5
"""Length over width from which an outline tells the direction of its crack."""

BESIDE: Final = 0.5
"""Length that two outlines have in common, as a share of the shorter one, from which they lie side by side."""

MOSTLY: Final = 0.5
"""Share of a piece in the whole that it is a part of."""


class _Stroke(NamedTuple):
    """An outline as a line."""

    middle: Float64Array
    along: Float64Array
    """Of length 1."""
    length_m: float
    width_m: float

    @property
    def ends(self) -> tuple[Float64Array, Float64Array]:
        half = self.along * self.length_m / 2
        return self.middle - half, self.middle + half


def may_be_piece(observation: Observation) -> bool:
    """Whether it is of a class that is detected in pieces: one that is registered as thin."""
    return observation.footprint is not None and is_thin(observation.kind.lower().replace(" ", "_"))


class Alignment(NamedTuple):
    """How two outlines lie that may be pieces of one crack, first what tells most; less is likelier one crack."""

    aside_m: float
    """The end of a piece beside the line of the other."""
    gap_m: float
    angle_cosine: float
    """Of the angle between them, negative: −1 where they are parallel."""


def alignment(one: Polygon, other: Polygon) -> Alignment | None:
    """None where two outlines are no pieces of one crack: these are slender, along one line, and not far from each
    other."""
    first, second = _stroke(one), _stroke(other)
    if first is None or second is None:
        return None
    cosine = abs(float(first.along @ second.along))
    aside_m = max(_aside_m(first, second), _aside_m(second, first))
    gap_m = float(one.distance(other))
    if cosine < cos(radians(ANGLE_DEG)) or gap_m > GAP_M or aside_m > ASIDE_M:
        return None
    return Alignment(max(aside_m, 0.0), gap_m, -cosine)


def are_beside(one: Observation, other: Observation) -> bool:
    """Whether two detections of one image that lie apart are side by side: of two cracks. Pieces of one follow one
    another."""
    if one.footprint is None or other.footprint is None:
        return False
    larger, smaller = sorted((one.footprint, other.footprint), key=lambda outline: (-outline.area, outline.wkb))
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(larger))
    if len(corners) < 5:
        return False
    sides = np.diff(corners[:3], axis=0)
    along = sides[int(np.argmax(np.hypot(*sides.T)))]
    (first, last), (begin, end) = (
        np.sort(shapely.get_coordinates(each) @ along)[[0, -1]] for each in (larger, smaller)
    )
    return bool(min(last, end) - max(first, begin) >= BESIDE * min(last - first, end - begin))


def _stroke(outline: Polygon) -> _Stroke | None:
    """The longer axis of the smallest rectangle around an outline; None for one that is not slender."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(outline))
    if len(corners) < 5:
        return None
    sides = np.diff(corners[:3], axis=0)
    lengths = np.hypot(*sides.T)
    longer = int(np.argmax(lengths))
    length_m, width_m = float(lengths[longer]), float(lengths[1 - longer])
    if length_m < SLENDER * width_m:
        return None
    return _Stroke(corners[:4].mean(axis=0), sides[longer] / length_m, length_m, width_m)


def _aside_m(piece: _Stroke, line: _Stroke) -> float:
    """How far the nearer end of a piece lies beside another one's line, their widths taken off."""
    near = min(piece.ends, key=lambda end: float(np.hypot(*(end - line.middle))))
    east, north = near - line.middle
    return float(abs(east * line.along[1] - north * line.along[0])) - (piece.width_m + line.width_m) / 2


def looks_of(observations: Iterable[Observation]) -> list[Observation]:
    """One observation for each image: what it shows of one defect in pieces is put together."""
    images: dict[str, list[Observation]] = {}
    for each in observations:
        images.setdefault(each.image, []).append(each)
    return [_together(mine) for mine in images.values()]


def _together(pieces: Sequence[Observation]) -> Observation:
    """Detections of one defect in one image as one: those that mostly lie in larger ones say the same again."""
    ordered = sorted(pieces, key=lambda each: 0.0 if each.footprint is None else -each.footprint.area)
    kept: list[Observation] = []
    for each in ordered:
        if all(shared(each, other) < MOSTLY for other in kept):
            kept.append(each)
    best = max(kept, key=lambda each: each.confidence)
    outlines = [each.footprint for each in kept if each.footprint is not None]
    if len(kept) == 1 or not outlines:
        return best
    outline = shapely.union_all(outlines).convex_hull
    assert isinstance(outline, Polygon)
    return replace(best, footprint=outline, sizes=_sizes(kept, outline), is_cut=any(each.is_cut for each in kept))


def _sizes(pieces: Sequence[Observation], outline: Polygon) -> dict[str, float]:
    """Areas and lengths of all pieces, the parts between them included in the length; other sizes of the largest."""
    sizes = dict(pieces[0].sizes)
    for name in ("area_m2", "length_m"):
        if name in sizes:
            sizes[name] = sum(each.sizes.get(name, 0.0) for each in pieces)
    if "length_m" in sizes:
        sides = np.hypot(*np.diff(shapely.get_coordinates(shapely.minimum_rotated_rectangle(outline)), axis=0).T)
        sizes["length_m"] = max(sizes["length_m"], float(sides.max(initial=0.0)))
    return sizes
