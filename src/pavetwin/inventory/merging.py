"""Which observations are of one defect.

Two observations of one class are of one defect where their footprints overlap, in one image by more than half of the
smaller one, or where in different images their places differ by no more than three standard deviations of the errors
that are stated. In the order of how sure that is, pairs are joined into groups, unless a group would then hold two
observations of one image that lie apart: what one image shows twice is two defects. Parts of a defect that one image
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

from pavetwin.inventory.observation import Observation
from pavetwin.inventory.pieces import GAP_M, MOSTLY, Alignment, alignment, are_beside, may_be_piece

SIGMAS: Final = 3.0

LEAST_SHARED: Final = 0.1
"""Overlap from which two footprints are one defect, as a share of the smaller one: neighbours may touch."""

LEAST_WHOLE: Final = 0.5
"""From so many images that show two groups as one on they are one, as a share of the images that show them apart."""

MOST_APART: Final = 7
"""So many images may show two pieces of a crack apart though too few show it whole."""

_Content = tuple[bytes, str, float]


def merged(observations: Sequence[Observation]) -> list[list[int]]:
    """Groups of observations (indices, in order), one for each defect; of one alone where it has no place."""
    group_of = list(range(len(observations)))
    members = {index: [index] for index in group_of}
    images = _Images(observations)

    def join(first: int, second: int) -> None:
        for index in members[second]:
            group_of[index] = first
        members[first] += members.pop(second)

    for _, one, other in sorted(_pairs(observations, images)):
        first, second = group_of[one], group_of[other]
        if first != second and not images.are_separate(members[first], members[second]):
            join(first, second)
    for _, one, other in sorted(_pieces(observations)):
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
    """Images in which one observation covers most of both of a pair of another image."""

    @property
    def shows_separate(self) -> bool:
        """Whether fewer images show them as one than `LEAST_WHOLE` of those that show them apart."""
        return self.whole < LEAST_WHOLE * self.apart


class _Images:
    """What the images show of observations: which of them are separate defects."""

    def __init__(self, observations: Sequence[Observation]) -> None:
        self._observations = observations
        self._shares = _shares(observations)

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
        return any(are_beside(self._observations[a], self._observations[b]) for a, b in evidence.pairs)

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
        return self._observations[index].image


def _shares(observations: Sequence[Observation]) -> dict[tuple[int, int], float]:
    """Of each two of one class that overlap, both ways round: the area in common as a share of the smaller one."""
    placed = [index for index, each in enumerate(observations) if each.footprint is not None]
    if not placed:
        return {}
    shapes = np.array([observations[index].footprint for index in placed])
    kinds = np.array([observations[index].kind for index in placed])
    one, other = shapely.STRtree(shapes).query(shapes, "intersects")
    wanted = (one != other) & (kinds[one] == kinds[other])
    one, other = one[wanted], other[wanted]
    areas = shapely.area(shapes)
    smaller = np.minimum(areas[one], areas[other])
    common = shapely.area(shapely.intersection(shapes[one], shapes[other]))
    shares = np.divide(common, smaller, out=np.zeros_like(common), where=smaller > 0)
    at = np.array(placed)
    return dict(zip(zip(at[one].tolist(), at[other].tolist(), strict=True), shares.tolist(), strict=True))


def _pieces(observations: Sequence[Observation]) -> Iterator[tuple[tuple[Alignment, _Content, _Content], int, int]]:
    """Pairs that go on in one another, each with what it is sorted by: how well, then what the two are, so that the
    order of the observations decides nothing."""
    thin = [index for index, each in enumerate(observations) if may_be_piece(each)]
    if not thin:
        return
    shapes = np.array([observations[index].footprint for index in thin])
    near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=GAP_M)
    for one, other in near.T.tolist():
        first, second = observations[thin[one]], observations[thin[other]]
        mine, others = _content(first), _content(second)
        if first.kind == second.kind and (mine, one) < (others, other):
            lie = alignment(shapes[one], shapes[other])
            if lie is not None:
                yield (lie, mine, others), thin[one], thin[other]


def _content(observation: Observation) -> _Content:
    """Tells observations of one class apart wherever they stand."""
    assert observation.footprint is not None
    return observation.footprint.wkb, observation.image, observation.confidence


def _pairs(observations: Sequence[Observation], images: _Images) -> Iterator[tuple[float, int, int]]:
    """Pairs that may be one defect, each with how unlikely that is: below 0 by the overlap, above by the distance."""
    placed = [index for index, each in enumerate(observations) if each.footprint is not None]
    if not placed:
        return
    shapes = np.array([observations[index].footprint for index in placed])
    reach = SIGMAS * 2**0.5 * max(observations[index].position_error_m for index in placed)
    tree = shapely.STRtree(shapes)
    found = tree.query(shapes, predicate="dwithin", distance=reach) if reach else tree.query(shapes, "intersects")
    for one, other in found.T.tolist():
        first, second = observations[placed[one]], observations[placed[other]]
        if one < other and first.kind == second.kind:
            unlikely = _unlikeliness(first, second, images.shared(placed[one], placed[other]))
            if unlikely < (-MOSTLY if first.image == second.image else inf):
                yield unlikely, placed[one], placed[other]


def _unlikeliness(first: Observation, second: Observation, overlap: float) -> float:
    """−1 (one within the other) … 0 by the share that overlaps; above 0 the distance in standard deviations; infinite
    for two defects."""
    if overlap >= LEAST_SHARED:
        return -overlap
    error_m = hypot(first.position_error_m, second.position_error_m)
    assert first.footprint is not None
    assert second.footprint is not None
    away = first.footprint.centroid.distance(second.footprint.centroid)
    return away / error_m if error_m and away <= SIGMAS * error_m else inf
