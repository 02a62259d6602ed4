"""Which observations are of one defect.

Two observations of one class are of one defect where their footprints overlap, in one image by more than half of the
smaller one, or where in different images their places differ by no more than three standard deviations of the errors
that are stated. In the order of how sure that is, pairs are joined into groups, unless a group would then hold two
observations of one image that lie apart: what one image shows twice is two defects. Parts of a defect that one image
shows in pieces are joined where another image shows it whole.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from math import hypot, inf
from typing import Final

import numpy as np
import shapely

from pavetwin.inventory.observation import Observation, shared
from pavetwin.inventory.pieces import GAP_M, MOSTLY, continues, may_be_piece

SIGMAS: Final = 3.0

LEAST_SHARED: Final = 0.1
"""Overlap from which two footprints are one defect, as a share of the smaller one: neighbours may touch."""


def merged(observations: Sequence[Observation]) -> list[list[int]]:
    """Groups of observations (indices, in order), one for each defect; of one alone where it has no place."""
    group_of = list(range(len(observations)))
    members = {index: [index] for index in group_of}

    def join(first: int, second: int) -> None:
        for index in members[second]:
            group_of[index] = first
        members[first] += members.pop(second)

    for _, one, other in sorted(_pairs(observations)):
        first, second = group_of[one], group_of[other]
        if first != second and not _conflict(observations, members[first], members[second]):
            join(first, second)
    for one, other in _pieces(observations):
        if group_of[one] != group_of[other]:
            join(group_of[one], group_of[other])
    return sorted(sorted(group) for group in members.values())


def _pieces(observations: Sequence[Observation]) -> Iterator[tuple[int, int]]:
    """Pairs that go on in one another."""
    thin = [index for index, each in enumerate(observations) if may_be_piece(each)]
    if not thin:
        return
    shapes = np.array([observations[index].footprint for index in thin])
    near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=GAP_M)
    for one, other in near.T.tolist():
        first, second = observations[thin[one]], observations[thin[other]]
        if one < other and first.kind == second.kind and continues(shapes[one], shapes[other]):
            yield thin[one], thin[other]


def _pairs(observations: Sequence[Observation]) -> Iterator[tuple[float, int, int]]:
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
            unlikely = _unlikeliness(first, second)
            if unlikely < (-MOSTLY if first.image == second.image else inf):
                yield unlikely, placed[one], placed[other]


def _unlikeliness(first: Observation, second: Observation) -> float:
    """−1 (one within the other) … 0 by the share that overlaps; above 0 the distance in standard deviations; infinite
    for two defects."""
    overlap = shared(first, second)
    if overlap >= LEAST_SHARED:
        return -overlap
    error_m = hypot(first.position_error_m, second.position_error_m)
    assert first.footprint is not None
    assert second.footprint is not None
    away = first.footprint.centroid.distance(second.footprint.centroid)
    return away / error_m if error_m and away <= SIGMAS * error_m else inf


def _conflict(observations: Sequence[Observation], one: Sequence[int], other: Sequence[int]) -> bool:
    """Whether two groups hold observations of one image that lie apart and that nothing whole covers."""
    return any(
        observations[a].image == observations[b].image
        and shared(observations[a], observations[b]) < LEAST_SHARED
        and not _bridged(observations, a, b, (*one, *other))
        for a, b in product(one, other)
    )


def _bridged(observations: Sequence[Observation], a: int, b: int, group: Sequence[int]) -> bool:
    """Whether another image shows two pieces as one, more surely than the pieces."""
    return any(
        shared(observations[whole], observations[a]) >= MOSTLY
        and shared(observations[whole], observations[b]) >= MOSTLY
        for whole in group
        if observations[whole].image != observations[a].image
    )
