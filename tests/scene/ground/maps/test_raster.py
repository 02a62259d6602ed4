"""Distances on a tile's grid, against shapely's."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.scene.ground.maps.raster import SIDE_M, RasterGrid, covered, painted, tracks

GRID = RasterGrid((0, 0), 32)
PLACE = st.integers(-20, int(SIDE_M) + 20).map(float)
LINES = st.lists(st.lists(st.tuples(PLACE, PLACE), min_size=2, max_size=4, unique=True), min_size=1, max_size=4)
BAR = st.tuples(PLACE, PLACE, st.floats(-math.pi, math.pi), st.floats(0.5, 6.0), st.floats(0.3, 3.0))
NEAR_EDGE_M = 1e-3


def cells() -> np.ndarray:
    """(32, 32) the middles of the cells, as points."""
    return shapely.points(*np.meshgrid(*GRID.world_axes()))


def box_of(x: float, y: float, yaw: float, half: float, wide: float) -> shapely.Polygon:
    ahead, left = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return shapely.Polygon([np.array([x, y]) + a * half * ahead + b * wide * left for a, b in corners])


@given(lines=LINES, reach_m=st.floats(0.5, 8.0))
def test_every_cell_knows_its_nearest_line(lines: list[list[tuple[float, float]]], reach_m: float) -> None:
    found = tracks(GRID, [np.array(line) for line in lines], [reach_m] * len(lines))
    nearest = np.min([shapely.distance(cells(), shapely.LineString(line)) for line in lines], axis=0)
    is_near = nearest < reach_m - NEAR_EDGE_M
    np.testing.assert_allclose(found.distance[is_near], nearest[is_near], atol=NEAR_EDGE_M)
    assert (found.index[is_near] >= 0).all()
    assert (found.index[nearest > reach_m + NEAR_EDGE_M] == -1).all()


@given(st.lists(BAR, min_size=1, max_size=5))
def test_later_bars_cover_earlier_ones(bars: list[tuple[float, ...]]) -> None:
    factors = np.arange(2.0, 2.0 + len(bars))
    tone = covered(GRID, np.array(bars), factors)
    expected, is_sure = np.ones((32, 32)), np.ones((32, 32), dtype=bool)
    for bar, factor in zip(bars, factors, strict=True):
        box = box_of(*bar)
        depth = shapely.distance(cells(), box.boundary)
        is_in = shapely.contains(box, cells())
        expected[is_in] = factor
        is_sure &= depth > GRID.cell_m  # a cell at the edge has a part of it
    np.testing.assert_allclose(tone[is_sure], expected[is_sure], rtol=1e-6)


@given(st.lists(BAR, min_size=1, max_size=5))
def test_paint_is_that_of_the_bar_a_cell_lies_farthest_inside(bars: list[tuple[float, ...]]) -> None:
    looks = np.column_stack([np.arange(1.0, len(bars) + 1), np.arange(1.0, len(bars) + 1)])
    reach_m = 0.5
    distance, first, second = painted(GRID, np.array(bars), looks, np.full(len(bars), 100.0), reach_m)
    depths = []
    for bar in bars:
        box = box_of(*bar)
        inside = np.where(shapely.contains(box, cells()), 1.0, -1.0)
        depths.append(inside * shapely.distance(cells(), box.boundary))
    inside = np.max(depths, axis=0)
    is_in = inside > NEAR_EDGE_M
    np.testing.assert_allclose(distance[is_in], inside[is_in], atol=NEAR_EDGE_M)
    best = np.sort(depths, axis=0)
    is_clear = is_in if len(bars) == 1 else is_in & (best[-1] - best[-2] > NEAR_EDGE_M)
    assert (first[is_clear] == np.argmax(depths, axis=0)[is_clear] + 1).all()
    assert (second == first).all()
    assert (distance[inside < -reach_m * math.sqrt(2) - NEAR_EDGE_M] == np.float32(-reach_m)).all()


def test_points_without_a_place_are_no_line() -> None:
    found = tracks(GRID, [np.array([[1.0, 1.0], [np.inf, 1.0]]), np.array([[2.0, 2.0], [2.0, 9.0]])], [3.0, 3.0])
    assert set(np.unique(found.index)) == {-1, 1}
    with pytest.raises(ValueError, match="dimension"):
        tracks(GRID, [np.zeros((2, 3))], [1.0])
