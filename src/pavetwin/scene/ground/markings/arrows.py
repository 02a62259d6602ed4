"""Arrows on lanes, 5 m long as in towns (RMS-1; MUTCD figure 3B-24 has much the same shapes)."""

from functools import cache
from typing import Final

import shapely

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Direction

LENGTH_M: Final = 5.0
SHAFT_M: Final = 0.15


@cache
def arrow(turns: frozenset[Direction]) -> tuple[Float64Array, ...]:
    """The outline of an arrow whose heads point straight on, left or right.

    (n, 2): x ahead from the shaft's foot, y to the left, metres.
    """
    parts = []
    if Direction.STRAIGHT in turns:
        parts += [_box(0.0, 3.4, 0.0), shapely.Polygon([(3.3, -0.45), (LENGTH_M, 0.0), (3.3, 0.45)])]
    for turn, side in ((Direction.LEFT, 1.0), (Direction.RIGHT, -1.0)):
        if turn in turns:
            parts += _branch(side, 1.4 if Direction.STRAIGHT in turns else 2.6)
            parts.append(_box(0.0, 2.0 if Direction.STRAIGHT in turns else 3.0, 0.0))
    whole = shapely.union_all(parts)
    return tuple(shapely.get_coordinates(shapely.get_exterior_ring(part))[:-1] for part in shapely.get_parts(whole))


def _branch(side: float, at: float) -> list[shapely.Polygon]:
    """A shaft that bends away and its head."""
    bend = [(at, 0.0), (at + 0.55, 0.10), (at + 0.95, 0.40), (at + 1.15, 0.75)]
    shaft = shapely.LineString([(x, side * y) for x, y in bend]).buffer(SHAFT_M, cap_style="flat", quad_segs=3)
    head = [(at + 0.55, 0.62), (at + 1.75, 0.62), (at + 1.35, 1.18)]
    return [shaft, shapely.Polygon([(x, side * y) for x, y in head])]


def _box(start: float, end: float, y: float) -> shapely.Polygon:
    return shapely.box(start, y - SHAFT_M / 2, end, y + SHAFT_M / 2)
