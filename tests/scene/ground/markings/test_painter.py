"""Lines as bars: they meet at corners without stubs and without gaps."""

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.scene.ground.markings.painter import Painter

WIDTH_M, UNEVEN_M = 0.12, 0.006
SLIVER_M2 = 5e-5


def painted(path: BaseGeometry) -> BaseGeometry:
    """What the bars of a line along a path cover."""
    painter = Painter()
    painter.line(path, WIDTH_M, 0.0)
    paint = painter.done()
    half = paint.bars[:, 4].tolist()
    bars = [LineString(ends).buffer(wide, cap_style="flat") for ends, wide in zip(paint.ends(), half, strict=True)]
    return shapely.union_all(bars)


@pytest.mark.parametrize(
    "ring",
    [
        [(0, 0), (2, 0), (2, 1), (0, 1)],
        [(0, 0), (9, 0), (9, 2), (0, 2)],  # longer than one bar may be
        [(0, 0), (2, 0), (3, 1.5), (1, 2.5), (-0.5, 1.2)],
    ],
)
def test_a_border_has_whole_corners_and_no_stubs(ring: list[tuple[float, float]]) -> None:
    area = Polygon(ring)
    found = painted(area.exterior)

    def border(half_m: float) -> BaseGeometry:
        outer, inner = (area.buffer(away, join_style="mitre") for away in (half_m, -half_m))
        return shapely.difference(outer, inner)

    assert shapely.difference(found, border(WIDTH_M / 2 + UNEVEN_M)).area < SLIVER_M2
    assert shapely.difference(border(WIDTH_M / 2 - UNEVEN_M), found).area < SLIVER_M2


def test_a_bent_line_has_no_gaps_where_its_bars_meet() -> None:
    turns = np.linspace(0.0, np.pi / 2, 12)
    path = LineString(np.column_stack([10 * np.sin(turns), 10 * np.cos(turns)]))
    found = painted(path)
    seen = path.buffer(WIDTH_M / 2 - 0.001, cap_style="flat")
    assert shapely.difference(seen, found).area < 5e-4, "without laps 25e-4"
    assert shapely.difference(found, path.buffer(WIDTH_M / 2 + UNEVEN_M)).area < 5e-4
