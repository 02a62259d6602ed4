"""Groups of detections of one defect.

Two detections of one class are of one defect where their footprints overlap, in one image by more than half of the
smaller one, or where in different images their places differ by no more than three standard deviations of the stated
errors. Pairs are joined into groups, the surest first, unless a group would then hold two detections of one image that
lie apart: two detections in one image are two defects. Parts of a defect in one image are joined where another image
shows it whole, and the images that show it whole are at least half as many as those that show the parts.

Cracks that continue one another are joined last, the best aligned first. Two cracks that an image shows side by side
are two, and so are two that many images show apart and few as one: a crack breaks at another place from image to image,
two cracks where they end.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import cos, hypot, inf, radians
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.detections import SIZES, Detections
from pavetwin.sensing.resolution import is_thin
from pavetwin.world.rectangles import smallest_rectangle

ANGLE_DEG: Final = 15.0
"""Largest angle between two pieces of one crack."""

ASIDE_M: Final = 0.15
"""Largest distance of a piece's end from the line of the other."""

GAP_M: Final = 1.0
"""Longest part of a crack that is not detected between two pieces."""

SLENDER: Final = 2.5
"""Length over width from which an outline gives the direction of its crack."""

BESIDE: Final = 0.5
"""Length that two outlines have in common, as a share of the shorter one, from which they lie side by side."""

MOSTLY: Final = 0.5
"""Share of a piece in the whole that it is a part of."""


class _Stroke(NamedTuple):
    """An outline as a line."""

    middle: Float64Array
    along: Float64Array
    """Unit vector."""
    length_m: float
    width_m: float

    @property
    def ends(self) -> tuple[Float64Array, Float64Array]:
        half = self.along * self.length_m / 2
        return self.middle - half, self.middle + half


class Alignment(NamedTuple):
    """Relative position of two outlines that may be pieces of one crack; smaller values, in order, are likelier."""

    aside_m: float
    """Distance of a piece's end from the line of the other."""
    gap_m: float
    angle_cosine: float
    """Negative cosine of the angle between them: −1 where they are parallel."""


def alignment(one: Polygon, other: Polygon) -> Alignment | None:
    """None where two outlines are not pieces of one crack: these are slender, along one line, and not far from each
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
    """Whether two separate outlines of one image lie side by side, as two cracks do. Pieces of one crack lie in
    line."""
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
    """Distance of a piece's nearer end from another piece's line, less half of both widths."""
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
    """Common area of two outlines, as a share of the smaller one; 0 if a place is unknown."""
    if first is None or second is None:
        return 0.0
    smaller = min(first.area, second.area)
    return float(first.intersection(second).area / smaller) if smaller else 0.0


SIGMAS: Final = 3.0

LEAST_SHARED: Final = 0.1
"""Overlap from which two footprints are one defect, as a share of the smaller one: neighbours may touch."""

LEAST_WHOLE: Final = 0.5
"""From so many images that show two groups as one on they are one, as a share of the images that show them apart."""

MOST_APART: Final = 7
"""So many images may show two pieces of a crack apart though too few show it whole."""

_Content = tuple[bytes, str, float]


def merged(detections: Detections) -> list[list[int]]:
    """Groups of detections (row numbers, in order), one for each defect; a detection without a place is alone."""
    group_of = list(range(len(detections)))
    members = {index: [index] for index in group_of}
    images = _Images(detections)

    def join(first: int, second: int) -> None:
        for index in members[second]:
            group_of[index] = first
        members[first] += members.pop(second)

    for _, one, other in sorted(_pairs(detections, images)):
        first, second = group_of[one], group_of[other]
        if first != second and not images.are_separate(members[first], members[second]):
            join(first, second)
    for _, one, other in sorted(_pieces(detections)):
        first, second = group_of[one], group_of[other]
        if first != second and not images.are_separate_cracks(members[first], members[second]):
            join(first, second)
    return sorted(sorted(group) for group in members.values())


class _Evidence(NamedTuple):
    """Evidence of images on whether two groups are one defect."""

    pairs: list[tuple[int, int]]
    """One of each group, of one image and apart in it."""
    apart: int
    """Images that show them so."""
    whole: int
    """Images in which one detection covers most of both of a pair of another image."""

    @property
    def shows_separate(self) -> bool:
        """Whether fewer images show them as one than `LEAST_WHOLE` of those that show them apart."""
        return self.whole < LEAST_WHOLE * self.apart


class _Images:
    """Evidence of images on which detections are separate defects."""

    def __init__(self, detections: Detections) -> None:
        self._detections = detections
        self._shares = _shares(detections)

    def shared(self, one: int, other: int) -> float:
        """The ground that two of one class have in common, as a share of the smaller one."""
        return self._shares.get((one, other), 0.0)

    def are_separate(self, one: Sequence[int], other: Sequence[int]) -> bool:
        """Whether some image separates two groups and too few images join them."""
        evidence = self._evidence(one, other)
        return not all(self._is_bridged(pair, (*one, *other)) for pair in evidence.pairs) or evidence.shows_separate

    def are_separate_cracks(self, one: Sequence[int], other: Sequence[int]) -> bool:
        """Whether images show two groups that may be pieces of one crack as two cracks: one image side by side, or many
        apart and too few as one."""
        evidence = self._evidence(one, other)
        if evidence.apart > MOST_APART and evidence.shows_separate:
            return True
        return any(are_beside(self._detections.footprint[a], self._detections.footprint[b]) for a, b in evidence.pairs)

    def _evidence(self, one: Sequence[int], other: Sequence[int]) -> _Evidence:
        of_image: dict[str, list[int]] = defaultdict(list)
        for index in other:
            of_image[self._image(index)].append(index)
        pairs = [(a, b) for a in one for b in of_image.get(self._image(a), ()) if self.shared(a, b) < LEAST_SHARED]
        whole = {
            self._image(index)
            for index in ((*one, *other) if pairs else ())
            if any(self._covers(index, pair) for pair in pairs)
        }
        return _Evidence(pairs, len({self._image(a) for a, _ in pairs}), len(whole))

    def _is_bridged(self, pair: tuple[int, int], group: Sequence[int]) -> bool:
        return any(self._covers(index, pair) for index in group)

    def _covers(self, whole: int, pair: tuple[int, int]) -> bool:
        """Whether another image shows both of a pair as a single defect."""
        return self._image(whole) != self._image(pair[0]) and all(self.shared(whole, part) >= MOSTLY for part in pair)

    def _image(self, index: int) -> str:
        return str(self._detections.image[index])


def _shares(detections: Detections) -> dict[tuple[int, int], float]:
    """Common area of overlapping detections of one class, in both orders, as a share of the smaller one."""
    placed = np.flatnonzero([outline is not None for outline in detections.footprint]).tolist()
    if not placed:
        return {}
    shapes = detections.footprint[placed]
    kinds = detections.class_name[placed]
    one, other = shapely.STRtree(shapes).query(shapes, "intersects")
    wanted = (one != other) & (kinds[one] == kinds[other])
    one, other = one[wanted], other[wanted]
    areas = shapely.area(shapes)
    smaller = np.minimum(areas[one], areas[other])
    common = shapely.area(shapely.intersection(shapes[one], shapes[other]))
    shares = np.divide(common, smaller, out=np.zeros_like(common), where=smaller > 0)
    at = np.array(placed)
    return dict(zip(zip(at[one].tolist(), at[other].tolist(), strict=True), shares.tolist(), strict=True))


def _pieces(detections: Detections) -> Iterator[tuple[tuple[Alignment, _Content, _Content], int, int]]:
    """Pairs in which one piece continues the other, each with its sort key: quality of the fit, then both pieces, so
    that the result does not depend on the order of detections."""
    thin = [
        index
        for index in range(len(detections))
        if detections.footprint[index] is not None and is_thin(detections.class_name[index])
    ]
    if not thin:
        return
    shapes = detections.footprint[thin]
    names = detections.class_name
    near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=GAP_M)
    for one, other in near.T.tolist():
        first, second = thin[one], thin[other]
        mine, others = _content(detections, first), _content(detections, second)
        if names[first] == names[second] and (mine, one) < (others, other):
            lie = alignment(shapes[one], shapes[other])
            if lie is not None:
                yield (lie, mine, others), first, second


def _content(detections: Detections, row: int) -> _Content:
    """Key that distinguishes detections of one class, whatever their order."""
    return detections.footprint[row].wkb, detections.image[row], float(detections.confidence[row])


def _pairs(detections: Detections, images: _Images) -> Iterator[tuple[float, int, int]]:
    """Pairs that may be one defect, each with how unlikely that is: below 0 by the overlap, above by the distance."""
    placed = np.flatnonzero([outline is not None for outline in detections.footprint]).tolist()
    if not placed:
        return
    shapes = detections.footprint[placed]
    reach = SIGMAS * 2**0.5 * float(detections.position_error_m[placed].max())
    tree = shapely.STRtree(shapes)
    found = tree.query(shapes, predicate="dwithin", distance=reach) if reach else tree.query(shapes, "intersects")
    for one, other in found.T.tolist():
        first, second = placed[one], placed[other]
        if one < other and detections.class_name[first] == detections.class_name[second]:
            unlikely = _unlikeliness(detections, first, second, images.shared(first, second))
            if unlikely < (-MOSTLY if detections.image[first] == detections.image[second] else inf):
                yield unlikely, first, second


def _unlikeliness(detections: Detections, first: int, second: int, overlap: float) -> float:
    """−1 (one within the other) … 0 by the share that overlaps; above 0 the distance in standard deviations; infinite
    for two defects."""
    if overlap >= LEAST_SHARED:
        return -overlap
    error_m = hypot(detections.position_error_m[first], detections.position_error_m[second])
    away = detections.footprint[first].centroid.distance(detections.footprint[second].centroid)
    return away / error_m if error_m and away <= SIGMAS * error_m else inf
