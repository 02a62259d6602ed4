"""Cracks in pieces: which detections go on in one another, and what an image shows in pieces as one look."""

from math import cos, radians
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.detections import SIZES, Detections
from pavetwin.world.rectangles import smallest_rectangle

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


def are_beside(one: Polygon | None, other: Polygon | None) -> bool:
    """Whether two outlines of one image that lie apart are side by side, as two cracks are. Pieces of one crack follow
    one another."""
    if one is None or other is None:
        return False
    larger, smaller = sorted((one, other), key=lambda outline: (-outline.area, outline.wkb))
    around = smallest_rectangle(larger)
    if around is None:
        return False
    (first, last), (begin, end) = (
        np.sort(shapely.get_coordinates(each) @ around.along)[[0, -1]] for each in (larger, smaller)
    )
    return bool(min(last, end) - max(first, begin) >= BESIDE * min(last - first, end - begin))


def _stroke(outline: Polygon) -> _Stroke | None:
    """The longer axis of the smallest rectangle around an outline; None for one that is not slender."""
    around = smallest_rectangle(outline)
    if around is None or around.length < SLENDER * around.width:
        return None
    return _Stroke(around.middle, around.along, around.length, around.width)


def _aside_m(piece: _Stroke, line: _Stroke) -> float:
    """How far the nearer end of a piece lies beside another one's line, their widths taken off."""
    near = min(piece.ends, key=lambda end: float(np.hypot(*(end - line.middle))))
    east, north = near - line.middle
    return float(abs(east * line.along[1] - north * line.along[0])) - (piece.width_m + line.width_m) / 2


def looks_of(detections: Detections) -> Detections:
    """One row for each image: the pieces of a defect in an image are joined."""
    rows: dict[str, list[int]] = {}
    for row, image in enumerate(detections.image):
        rows.setdefault(image, []).append(row)
    return Detections.concatenated([_joined(detections[mine]) for mine in rows.values()])


def _joined(pieces: Detections) -> Detections:
    """Detections of one defect in one image as one; those that mostly lie in larger ones are left out."""
    outlines = pieces.footprint
    areas = np.array([0.0 if outline is None else -outline.area for outline in outlines])
    kept: list[int] = []
    for row in np.argsort(areas, kind="stable").tolist():
        if all(_shared(outlines[row], outlines[other]) < MOSTLY for other in kept):
            kept.append(row)
    best = max(kept, key=lambda row: float(pieces.confidence[row]))
    placed = [outlines[row] for row in kept if outlines[row] is not None]
    if len(kept) == 1 or not placed:
        return pieces[[best]]
    outline = shapely.union_all(placed).convex_hull
    assert isinstance(outline, Polygon)
    return pieces[[best]].with_columns(
        footprint=[outline], is_cut=[bool(pieces.is_cut[kept].any())], **_joined_sizes(pieces[kept], outline)
    )


def _joined_sizes(pieces: Detections, outline: Polygon) -> dict[str, list[float]]:
    """Areas and lengths of all pieces, the length including the gaps between them; other sizes of the largest."""
    sizes = {name: float(getattr(pieces, name)[0]) for name in SIZES}
    for name in ("area_m2", "length_m"):
        if not np.isnan(sizes[name]):
            sizes[name] = float(np.nansum(getattr(pieces, name)))
    if not np.isnan(sizes["length_m"]):
        around = smallest_rectangle(outline)
        sizes["length_m"] = max(sizes["length_m"], 0.0 if around is None else around.length)
    return {name: [value] for name, value in sizes.items()}


def _shared(first: Polygon | None, second: Polygon | None) -> float:
    """The area that two outlines share, as a share of the smaller one; 0 where a place is not known."""
    if first is None or second is None:
        return 0.0
    smaller = min(first.area, second.area)
    return float(first.intersection(second).area / smaller) if smaller else 0.0
