"""Which options are worth considering: those that no other beats in gain and cost at once (the Pareto front)."""

from collections.abc import Sequence

Point = tuple[float, float]
"""Gain (more is better) and cost (less is better)."""


def dominates(one: Point, other: Point) -> bool:
    """Whether `one` is at least as good in both and better in one."""
    return one[0] >= other[0] and one[1] <= other[1] and one != other


def on_front(points: Sequence[Point]) -> list[bool]:
    """For each point, whether none dominates it. Equal points are on the front together."""
    return [not any(dominates(one, point) for one in points) for point in points]
