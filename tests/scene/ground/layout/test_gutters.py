"""Gutters lie along kerbs, go around corners or end thin, and no defect of asphalt reaches into them."""

from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.defects import DefectOptions, place
from pavetwin.scene.ground import GroundPlan, ground_pieces, plan_ground
from pavetwin.scene.ground.layout.kerbside import TAPER_M
from pavetwin.scene.patches import holes_of
from pavetwin.scene.values import TILE_M, GroundKind
from pavetwin.world.pavement_joints import GUTTER_M, has_gutter
from scenes import built

NAMES = ("berlin_neukoelln", "seattle_roosevelt")


@cache
def plan(name: str) -> GroundPlan:
    return plan_ground(built(name).world, 3)


@pytest.mark.parametrize("name", NAMES)
def test_some_streets_have_gutters_along_their_kerbs_and_others_none(name: str) -> None:
    where = plan(name)
    gutters, road = shapely.union_all(where.gutters.shapes), where.world.carriageway
    assert gutters.area > 50
    assert gutters.difference(road.buffer(0.01)).area < 1e-6
    assert gutters.difference(road.boundary.buffer(GUTTER_M + 0.03)).area < 0.01 * gutters.area
    for segment in where.world.segments:
        if not has_gutter(segment.street):
            assert gutters.intersection(segment.polygon).area < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_gutters_narrow_to_nothing_where_they_end(name: str) -> None:
    """From a hand's breadth before its end to its end a gutter is narrower than a third of its width."""
    where = plan(name)
    gutters = shapely.union_all(where.gutters.shapes)
    free = shapely.line_merge(shapely.difference(where.world.carriageway.boundary, gutters.buffer(0.01)))
    widths, before = [], []
    for line in shapely.get_parts(free):
        if line.length < 2 * TAPER_M + 1:
            continue
        for end, out in ((0.0, -1.0), (line.length, 1.0)):
            spot = line.interpolate(end)
            inner = line.interpolate(end - out * 0.5)
            step = np.array([spot.x - inner.x, spot.y - inner.y]) / spot.distance(inner)
            for back, found in ((0.15, widths), (TAPER_M + 0.3, before)):
                at = np.array([spot.x, spot.y]) + back * step
                across = shapely.LineString([at + 0.6 * step[::-1] * (-1, 1), at - 0.6 * step[::-1] * (-1, 1)])
                found.append(shapely.intersection(across, gutters).length)
    assert len(widths) > 4
    assert np.median(widths) < GUTTER_M / 3
    assert np.median(before) > 0.8 * GUTTER_M


@pytest.mark.slow
def test_no_defect_reaches_into_a_gutter() -> None:
    """Not even the ring about it that is drawn again; on streets without gutters some come nearer to the edge."""
    where = plan("berlin_neukoelln")
    with_gutter = [segment for segment in where.world.segments if has_gutter(segment.street)][:4]
    without = [segment for segment in where.world.segments if not has_gutter(segment.street)][:4]
    options = DefectOptions(population="paper", per_segment=40)
    gutters = shapely.union_all(where.gutters.shapes)
    placed = place(with_gutter, 5, options)
    assert len(placed) > 60
    assert shapely.intersection(shapely.union_all(holes_of(placed)), gutters).area == 0
    edges = where.world.carriageway.boundary
    assert min(defect.polygon.distance(edges) for defect in placed) > GUTTER_M
    assert min(defect.polygon.distance(edges) for defect in place(without, 5, options)) < GUTTER_M


def test_gutters_are_of_concrete_and_the_road_beside_them_of_asphalt() -> None:
    where = plan("berlin_neukoelln")
    gutter = max(where.gutters.shapes, key=lambda shape: float(shape.area))
    spot = gutter.representative_point()
    key = int(spot.x // TILE_M), int(spot.y // TILE_M)
    area = {}
    for piece in ground_pieces(where, key):
        corners = piece.mesh.positions[piece.mesh.indices].astype(float)[..., :2] + np.array(key) * TILE_M
        middles = shapely.points(corners.mean(axis=1))
        sizes = np.array([shapely.Polygon(triangle).area for triangle in corners])
        area[piece.kind] = float(sizes[shapely.intersects(gutter.buffer(-1e-4), middles)].sum())
    box = shapely.box(key[0] * TILE_M, key[1] * TILE_M, (key[0] + 1) * TILE_M, (key[1] + 1) * TILE_M)
    expected = shapely.intersection(gutter, box).area
    assert area[GroundKind.CONCRETE] == pytest.approx(expected, rel=0.02)
    assert area.get(GroundKind.ASPHALT, 0.0) < 0.02 * expected
