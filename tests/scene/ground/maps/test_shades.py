"""Brightness of pavements by finish and maps, and distances on a tile's grid against Shapely's."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, affinity

from pavetwin.config.named import names_in
from pavetwin.scene.ground import GroundPlan, ground_maps, ground_pieces, plan_ground
from pavetwin.scene.ground.distractors.segment_marks import Repairs
from pavetwin.scene.ground.layout.paved import REFLECTANCES, PavedSurface
from pavetwin.scene.ground.maps.raster import SIDE_M, RasterGrid, covered, filled, painted, tracks
from pavetwin.scene.ground.materials.compose import surface
from pavetwin.scene.ground.styles import pavement, street_style
from pavetwin.scene.ground.styles.pavement import PACKAGE
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import MAP_MARGIN_M, MAP_PX, TILE_M
from scenes import tiny

TEXEL_M = (TILE_M + 2 * MAP_MARGIN_M) / MAP_PX
PLACE = (16.0, 0.0)
"""On the street of `tiny.straight`, in the middle of a tile along it."""


def key_at(x: float, y: float) -> tuple[int, int]:
    return int(x // TILE_M), int(y // TILE_M)


@cache
def one_pavement(name: str, folder: Path) -> GroundPlan:
    """A street of one pavement without repairs, and the same seed for each."""
    style = {"title": "one", "main": {name: 1}, "other": {name: 1}, "stretches": {"share": 0, "pavements": {name: 1}}}
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(style), encoding="utf-8")
    found = plan_ground(tiny.straight(), 3, style=street_style(str(folder / f"{name}.yaml")))
    found.__dict__["repairs"] = Repairs()
    return found


@pytest.mark.parametrize("name", names_in(PACKAGE, "pavements"))
def test_a_street_is_as_bright_as_its_pavement(name: str, tmp_path: Path) -> None:
    plan = one_pavement(name, tmp_path)
    (street,) = plan.streets
    wanted = plan.ageing(street).reflectance
    of = pavement(name).reflectance
    assert wanted == pytest.approx(of.at(plan.ageing(street).age, 0.5), rel=of.spread + 1e-9)
    line = plan.world.segments[0].centre_line
    middle = line.interpolate(0.5, normalized=True)
    key = key_at(middle.x, middle.y)
    maps, origin = ground_maps(plan, key), (key[0] * TILE_M, key[1] * TILE_M)
    kind = pavement(name).material.ground
    (piece,) = {each.finish for each in ground_pieces(plan, key) if each.kind is kind}
    xy = np.random.default_rng(1).uniform(0, TILE_M, (20000, 2)) + origin
    xy = xy[shapely.contains_xy(plan.world.segments[0].polygon.buffer(-0.8), *xy.T)]
    assert len(xy) > 500
    seen = surface(kind, xy, xy - origin, origin, maps, 0.05, piece).albedo.mean(axis=-1)
    assert np.median(seen) == pytest.approx(wanted, rel=0.13)


def shaded(plain: GroundPlan, repairs: Repairs, holes: tuple[Polygon, ...] = ()) -> np.ndarray:
    """The factor by which the tone in the tile at PLACE differs from a plan without repairs, (MAP_PX, MAP_PX)."""
    changed = plan_ground(plain.world, plain.seed, holes, style=plain.style)
    changed.__dict__["repairs"] = repairs
    tones = [ground_maps(plan, key_at(*PLACE)).weathering[..., 0].astype(float) for plan in (changed, plain)]
    return np.asarray(tones[0] / tones[1])


def inside(shape: Polygon, by_m: float) -> np.ndarray:
    """Which texels of the tile at PLACE lie in a shape made narrower by some metres."""
    axes = ((np.arange(MAP_PX) + 0.5) * TEXEL_M - MAP_MARGIN_M + TILE_M * each for each in key_at(*PLACE))
    x, y = np.meshgrid(*axes)
    return np.asarray(shapely.contains_xy(shape.buffer(-by_m), x, y))


def test_lanes_that_were_paved_apart_differ_up_to_their_edge_which_is_smooth(tmp_path: Path) -> None:
    plain = one_pavement("dense_asphalt", tmp_path)
    segment, (street,) = plain.world.segments[0], plain.streets
    lane = affinity.rotate(shapely.box(*PLACE, PLACE[0] + 8.0, PLACE[1] + 1.5), 7.0)
    lane = shapely.intersection(lane, shapely.intersection(segment.polygon, shapely.box(*tile(PLACE))))
    assert lane.area > 5
    surface = plain.surface_of(street)
    factor = shaded(plain, Repairs(lanes={segment.id: [(lane, replace(surface, shade=1.25))]}))
    assert np.median(factor[inside(lane, 0.05)]) == pytest.approx(1.25, abs=0.01)
    beside = inside(lane, -0.3) & ~inside(lane, -0.05)
    assert np.median(factor[beside]) == pytest.approx(1.0, abs=0.005)
    edge = factor[inside(lane, -TEXEL_M) & ~inside(lane, TEXEL_M)]
    assert ((edge > 1.04) & (edge < 1.21)).mean() > 0.25, "a staircase has no values between"
    share = (factor[inside(lane, -0.1)] - 1.0).sum() / 0.25 * TEXEL_M**2
    assert share == pytest.approx(lane.area, abs=0.007 * lane.length)


def tile(place: tuple[float, float]) -> tuple[float, float, float, float]:
    (column, row) = key_at(*place)
    return column * TILE_M, row * TILE_M, (column + 1) * TILE_M, (row + 1) * TILE_M


def test_the_patch_of_a_defect_across_a_joint_is_as_bright_as_the_pavement_on_either_side(tmp_path: Path) -> None:
    plain = one_pavement("dense_asphalt", tmp_path)
    segment = plain.world.segments[0]
    x, y = PLACE[0], PLACE[1] + 0.8
    dark = PavedSurface.of(pavement("overlay"), 0.6 * plain.surface_of(plain.streets[0]).reflectance, 0.5, 0.5)
    cut, hole = shapely.box(x, y - 0.5, x + 3.0, y + 0.5), shapely.box(x - 0.6, y - 0.1, x + 0.4, y + 0.1)
    repairs = Repairs(cuts={segment.id: [(cut, dark)]})
    factor = shaded(plain, repairs, (hole,))
    in_cut, beside = shapely.intersection(hole, cut), shapely.difference(hole, cut)
    assert np.median(factor[inside(beside, 0.05)]) == pytest.approx(1.0, abs=0.005)
    wanted = dark.reflectance / plain.surface_of(plain.streets[0]).reflectance
    assert wanted == pytest.approx(0.6, abs=0.01)
    assert np.median(factor[inside(in_cut, 0.05)]) == pytest.approx(wanted, abs=0.015)
    # Around the patch the mesh is cut, and its finish says how dark the repair is.
    assert np.median(factor[inside(shapely.difference(cut, hole.buffer(0.1)), 0.05)]) == pytest.approx(1.0, abs=0.005)


def test_a_patch_has_the_finish_of_the_pavement_in_its_middle() -> None:
    there = tiny.straight((20.0, 1.0))
    scene = Scene(there, seed=3, style="varied")
    patch = scene.patch_on(key_at(20.0, 1.0), 0)
    assert patch is not None
    paved = scene._plan.paved_at(20.0, 1.0)
    assert (patch.kind, patch.finish) == paved.material
    assert paved.reflectance == pytest.approx(REFLECTANCES[paved.kind] * paved.finish.tone * paved.shade)


@given(
    st.lists(st.tuples(st.floats(2, 30), st.floats(2, 30)), min_size=3, max_size=3, unique=True),
    st.integers(20, 250),
)
def test_filled_polygons_have_their_area(corners: list[tuple[float, float]], level: int) -> None:
    """To within a fourth of a cell along the edge, since samples that the edge touches are filled, and a cell at each
    corner."""
    shape, raster = Polygon(corners), RasterGrid((0, 0), 256)
    found = filled(raster, [(shape.exterior, level)], 0)
    area = float(found.sum()) / level * raster.cell_m**2
    assert area == pytest.approx(shape.area, abs=raster.cell_m * (0.25 * shape.length + 4 * raster.cell_m))


GRID = RasterGrid((0, 0), 32)
COORDINATE = st.integers(-20, int(SIDE_M) + 20).map(float)
LINES = st.lists(
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=2, max_size=4, unique=True), min_size=1, max_size=4
)
BAR = st.tuples(COORDINATE, COORDINATE, st.floats(-math.pi, math.pi), st.floats(0.5, 6.0), st.floats(0.3, 3.0))
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
