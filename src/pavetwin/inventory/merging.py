"""Which detections are of one defect.

Two detections of one class are of one defect where their footprints overlap, in one image by more than half of the
smaller one, or where in different images their places differ by no more than three standard deviations of the errors
that are stated. In the order of how sure that is, pairs are joined into groups, unless a group would then hold two
detections of one image that lie apart: what one image shows twice is two defects. Parts of a defect that one image
shows in pieces are joined where another image shows it whole, and images that show it so are at least half as many as
those that show the parts.

Cracks that go on in one another are joined last, those that lie best along one line first. Two that an image shows
side by side are two, and so are two that many images show apart and few as one: a crack breaks at another place from
image to image, two cracks where they end.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import hypot, inf
from typing import Final, NamedTuple

import numpy as np
import shapely

from pavetwin.detections import Detections
from pavetwin.inventory.pieces import GAP_M, MOSTLY, Alignment, alignment, are_beside
from pavetwin.sensing.resolution import is_thin

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
    """What images show of two groups."""

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
    """What the images show of detections: which of them are separate defects."""

    def __init__(self, detections: Detections) -> None:
        self._detections = detections
        self._shares = _shares(detections)

    def shared(self, one: int, other: int) -> float:
        """The ground that two of one class have in common, as a share of the smaller one."""
        return self._shares.get((one, other), 0.0)

    def are_separate(self, one: Sequence[int], other: Sequence[int]) -> bool:
        """Whether an image shows two groups apart and no other one as one, or too few do."""
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
        """Whether another image shows the two of a pair as one."""
        return self._image(whole) != self._image(pair[0]) and all(self.shared(whole, part) >= MOSTLY for part in pair)

    def _image(self, index: int) -> str:
        return str(self._detections.image[index])


def _shares(detections: Detections) -> dict[tuple[int, int], float]:
    """Of each two of one class that overlap, both ways round: the area in common as a share of the smaller one."""
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
    """Pairs that go on in one another, each with what it is sorted by: how well, then what the two are, so that the
    order of the detections decides nothing."""
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
