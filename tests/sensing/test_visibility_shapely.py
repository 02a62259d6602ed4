"""The kernel's visible cells against shadows drawn by Shapely.

From a camera at height H over the nadir q, a body between the heights a and b throws its base B on the ground as
q + (B − q)·H/(H − z) for z from a to b; the shadow is the convex hull of the two ends. Nothing of this is the kernel's:
it is geometry written down a second time, with another library. The two must agree on every cell whose centre is not
within 10⁻⁶ m of an edge.
"""

from dataclasses import dataclass
from functools import cache
from math import cos, hypot, pi, radians, sin, tan

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from shapely import MultiPoint, Point, Polygon
from shapely.affinity import scale

from pavetwin._core import Ground, NadirCamera, Trace, Viewpoint
from pavetwin.navigation.navmesh import navmesh
from scenes.tiny import Mover, Size, parked, straight, trace_of

EDGE_M = 1e-6
ROUND_SIDES = 512
IMAGE_PX, FOV_RAD = (1270, 950), radians(60)


@dataclass(frozen=True)
class Block:
    """A static prism over a convex base."""

    base: Polygon
    low_m: float
    high_m: float


@dataclass(frozen=True)
class View:
    east_m: float
    north_m: float
    altitude_m: float
    yaw_rad: float
    rows: float
    across_per_altitude: float


def shadow(base: shapely.Geometry, low_m: float, high_m: float, view: View) -> shapely.Geometry:
    """The ground hidden by a body that reaches at most to just below the camera."""
    if low_m >= view.altitude_m * (1 - 1e-6):
        return Polygon()
    high_m = min(high_m, view.altitude_m * (1 - 1e-6))
    ends = []
    for height_m in (low_m, high_m):
        factor = view.altitude_m / (view.altitude_m - height_m)
        ends.append(scale(base, factor, factor, origin=(view.east_m, view.north_m)))
    return shapely.union_all(ends).convex_hull


def body(mover: Mover, time_s: float = 0.0) -> Polygon:
    """An agent's outline: a turned box, or a circle for a person."""
    pose = mover.pose(time_s)
    assert pose is not None
    # As the recording holds it, in single precision.
    x, y, yaw = (float(np.float32(value)) for value in pose[:3])
    length, width = float(np.float32(mover.size.length_m)), float(np.float32(mover.size.width_m))
    if mover.size.is_pedestrian:
        circle = Point(x, y).buffer(width / 2, quad_segs=ROUND_SIDES // 4)
        assert isinstance(circle, Polygon)
        return circle
    ahead, left = np.array([cos(yaw), sin(yaw)]) * length / 2, np.array([-sin(yaw), cos(yaw)]) * width / 2
    return Polygon([np.array([x, y]) + a * ahead + b * left for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])


def window(view: View) -> Polygon:
    along = 2 * view.altitude_m * tan(FOV_RAD / 2)
    across = min(along * IMAGE_PX[0] / IMAGE_PX[1], view.across_per_altitude * view.altitude_m)
    ahead = np.array([cos(view.yaw_rad), sin(view.yaw_rad)]) * along * view.rows / 2
    left = np.array([-sin(view.yaw_rad), cos(view.yaw_rad)]) * across / 2
    at = np.array([view.east_m, view.north_m])
    return Polygon([at + a * ahead + b * left for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])


def drawn(view: View, surface: Polygon, blocks: list[Block], movers: list[Mover], cell_m: float):
    """By Shapely: the centres of C and of V, and those that lie so near to an edge that either answer is right."""
    frame = window(view)
    still = shapely.union_all([shadow(block.base, block.low_m, block.high_m, view) for block in blocks])
    moving = shapely.union_all(
        [shadow(body(mover), 0.0, float(np.float32(mover.size.height_m)), view) for mover in movers]
    )
    west, south, east, north = surface.bounds
    index_x = np.arange(np.floor(west / cell_m) - 1, np.ceil(east / cell_m) + 1)
    index_y = np.arange(np.floor(south / cell_m) - 1, np.ceil(north / cell_m) + 1)
    x, y = np.meshgrid((index_x + 0.5) * cell_m, (index_y + 0.5) * cell_m)
    centres = np.stack([x.ravel(), y.ravel()], axis=1)
    points = shapely.points(centres)
    is_candidate = shapely.covers(surface, points) & shapely.covers(frame, points) & ~shapely.covers(still, points)
    is_visible = is_candidate & ~shapely.covers(moving, points)
    # A circle drawn with sides lies inside the true one by less than r (1 − cos(π / sides)), thrown on the ground.
    people = [mover for mover in movers if mover.size.is_pedestrian]
    slack = max((mover.size.width_m * (1 - cos(pi / ROUND_SIDES)) * 40 for mover in people), default=0.0) + EDGE_M
    edges = shapely.union_all([shape.boundary for shape in (surface, frame, still, moving) if not shape.is_empty])
    near = shapely.distance(edges, points) <= slack
    return centres[is_candidate], centres[is_visible], centres[near]


@cache
def mesh():
    """A mesh is needed to make a ground, but nothing looks at it here."""
    return navmesh(straight(), 10.0, 0.5)


def ground(surface: Polygon, blocks: list[Block], cell_m: float) -> Ground:
    bases = [np.asarray(block.base.exterior.coords)[:-1] for block in blocks]
    return Ground(
        mesh(),
        cell_m=cell_m,
        surface_rings=[[shapely.get_coordinates(surface.exterior)]],
        solid_offsets=np.concatenate([[0], np.cumsum([len(base) for base in bases])]).astype(np.uint32),
        solid_xy=np.concatenate(bases) if bases else np.empty((0, 2)),
        solid_z0=np.array([block.low_m for block in blocks]),
        solid_z1=np.array([block.high_m for block in blocks]),
        solid_is_parked=np.zeros(len(blocks), dtype=bool),
        defect_centres=np.empty((0, 2)),
        defect_segments=np.empty(0, dtype=np.uint32),
        defect_points=lambda _: np.empty((0, 2)),
    )


def looked(view: View, surface: Polygon, blocks: list[Block], trace: Trace, cell_m: float):
    return ground(surface, blocks, cell_m).observe(
        0,
        trace,
        0.0,
        NadirCamera(
            image_px=IMAGE_PX,
            vertical_fov_rad=FOV_RAD,
            window_rows=view.rows,
            window_across_per_altitude=view.across_per_altitude,
        ),
        Viewpoint(position=(view.east_m, view.north_m), altitude_m=view.altitude_m, yaw_rad=view.yaw_rad),
    )


def keys(centres: np.ndarray, cell_m: float) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in np.floor(np.asarray(centres).reshape(-1, 2) / cell_m)}


def assert_agree(view: View, surface: Polygon, blocks: list[Block], movers: list[Mover], cell_m: float = 0.25) -> None:
    """Cell by cell, those at an edge excepted."""
    ours = looked(view, surface, blocks, trace_of(movers, 1.0), cell_m)
    candidates, visible, near = (keys(cells, cell_m) for cells in drawn(view, surface, blocks, movers, cell_m))
    assert keys(ours["candidates"], cell_m) ^ candidates <= near
    assert keys(ours["visible"], cell_m) ^ visible <= near
    seen, possible = len(ours["visible"]), len(ours["candidates"])
    assert ours["visibility"] == (pytest.approx(seen / possible) if possible else None)
    hidden = keys(ours["candidates"], cell_m) - keys(ours["visible"], cell_m)
    if hidden:
        centroid = (np.mean(sorted(hidden), axis=0) + 0.5) * cell_m
        assert ours["hidden_place"] == pytest.approx(tuple(centroid))
    else:
        assert ours["hidden_place"] is None


# Random scenes.

metres = st.floats(-14.0, 14.0, allow_nan=False)
angles = st.floats(-pi, pi, allow_nan=False)


@st.composite
def movers(draw: st.DrawFn) -> Mover:
    x, y, yaw = draw(metres), draw(metres), draw(angles)
    if draw(st.booleans()):
        return parked(x, y, Size(0.5, draw(st.floats(0.3, 0.9)), draw(st.floats(0.8, 2.1)), is_pedestrian=True))
    size = Size(draw(st.floats(1.5, 18.0)), draw(st.floats(0.6, 2.6)), draw(st.floats(0.8, 4.2)))
    return parked(x, y, size, yaw_rad=yaw)


@st.composite
def blocks(draw: st.DrawFn) -> Block:
    """A convex polygon with any number of corners, from the ground or hovering like a crown or a signal's arm."""
    x, y, radius = draw(metres), draw(metres), draw(st.floats(0.3, 6.0))
    turns = sorted(draw(st.lists(st.floats(0, 2 * pi), min_size=3, max_size=9, unique=True)))
    hull = MultiPoint([(x + radius * cos(a), y + radius * sin(a)) for a in turns]).convex_hull
    if not isinstance(hull, Polygon) or hull.area < 0.05:
        square = shapely.box(x, y, x + radius, y + radius)
        assert isinstance(square, Polygon)
        hull = square
    hull = shapely.remove_repeated_points(hull, 1e-3)
    assert isinstance(hull, Polygon)
    low = draw(st.sampled_from([0.0, 0.0, 2.5, 4.5]))
    return Block(shapely.orient_polygons(hull), low, low + draw(st.floats(0.5, 30.0)))


views = st.builds(
    View,
    st.floats(-5.0, 5.0),
    st.floats(-5.0, 5.0),
    st.sampled_from([3.0, 6.0, 10.0, 15.0]) | st.floats(4.0, 30.0),
    angles | st.sampled_from([0.0, pi / 2, -pi / 4]),
    st.sampled_from([260 / 950, 0.5, 1.0]),
    st.sampled_from([0.6, 1.0, 9.0]),
)
surfaces = st.sampled_from(
    [
        shapely.box(-30, -3.5, 30, 3.5),
        shapely.box(-6, -20, 9.3, 20),
        Polygon([(-20, -4), (0, -3), (20, -9), (22, -2), (0, 4), (-21, 3.1)]),
    ]
)


@pytest.mark.slow
@examples(max_examples=150)
@given(views, surfaces, st.lists(movers(), max_size=6), st.lists(blocks(), max_size=3))
def test_the_kernel_sees_the_cells_that_shapely_sees(
    view: View, surface: Polygon, agents: list[Mover], standing: list[Block]
) -> None:
    assert_agree(view, surface, standing, agents)


@pytest.mark.slow
@examples(max_examples=40)
@given(views, st.lists(movers(), min_size=1, max_size=3), st.sampled_from([0.1, 0.5, 1.0]))
def test_they_agree_at_other_cell_sizes(view: View, agents: list[Mover], cell_m: float) -> None:
    assert_agree(view, shapely.box(-12, -6, 12, 6), [], agents, cell_m)


# Scenes worked out by hand.

STREET = shapely.box(-30, -3.5, 30, 3.5)
ABOVE = View(0.0, 0.0, 10.0, 0.0, 0.5, 9.0)


def hidden_box(view: View, movers: list[Mover], standing: list[Block] | None = None):
    ours = looked(view, STREET, standing or [], trace_of(movers, 1.0), 0.25)
    cells = keys(ours["candidates"], 0.25) - keys(ours["visible"], 0.25)
    rows = np.array(sorted(cells)).reshape(-1, 2)
    return (rows.min(axis=0) * 0.25, (rows.max(axis=0) + 1) * 0.25) if len(rows) else None


def test_a_box_below_the_camera_hides_its_top_thrown_on_the_ground() -> None:
    """2 × 2 m, 5 m high, seen from 10 m: the shadow is 4 × 4 m."""
    low, high = hidden_box(ABOVE, [parked(0, 0, Size(2, 2, 5))])
    assert low == pytest.approx([-2, -2])
    assert high == pytest.approx([2, 2])


def test_a_box_aside_hides_what_is_behind_it() -> None:
    """From y = 1 to 2, 5 m high: hidden from 1 to 4, cut at the kerb at 3.5."""
    low, high = hidden_box(ABOVE, [parked(0, 1.5, Size(2, 1, 5))])
    assert low[1] == pytest.approx(1.0)
    assert high[1] == pytest.approx(3.5)


def test_a_truck_as_high_as_the_camera_hides_all_behind_it_and_nothing_before_it() -> None:
    view = View(0.0, 0.0, 3.0, 0.0, 1.0, 9.0)
    low, high = hidden_box(view, [parked(0, 1.6, Size(40, 1, 3.0))])
    assert low[1] == pytest.approx(1.0, abs=0.13)
    assert high[1] == pytest.approx(2.5, abs=0.3)  # the window's edge at 2.3 m


def test_a_roof_above_the_camera_hides_nothing() -> None:
    roof = Block(shapely.orient_polygons(shapely.box(-9, -9, 9, 9)), 12.0, 15.0)
    ours = looked(ABOVE, STREET, [roof], trace_of([], 1.0), 0.25)
    bare = looked(ABOVE, STREET, [], trace_of([], 1.0), 0.25)
    assert len(ours["candidates"]) == len(bare["candidates"]) > 400


def test_what_a_solid_hides_is_no_candidate_and_blames_no_agent() -> None:
    wall = Block(shapely.orient_polygons(shapely.box(-9, -9, 9, 0)), 0.0, 9.0)
    ours = looked(ABOVE, STREET, [wall], trace_of([parked(0, -2, Size(4, 2, 2))], 1.0), 0.25)
    assert ours["visibility"] == 1.0
    assert ours["candidates"][:, 1].min() > 0


def test_where_nothing_can_be_seen_visibility_is_undefined() -> None:
    away = View(500.0, 0.0, 10.0, 0.0, 0.5, 9.0)
    ours = looked(away, STREET, [], trace_of([], 1.0), 0.25)
    assert ours["visibility"] is None
    assert ours["hidden_place"] is None
    assert ours["candidates"].shape == ours["visible"].shape == (0, 2)


def test_a_bare_streets_cells_are_its_area() -> None:
    ours = looked(ABOVE, STREET, [], trace_of([], 1.0), 0.25)
    assert ours["visibility"] == 1.0
    frame = window(ABOVE).intersection(STREET)
    assert len(ours["visible"]) * 0.25**2 == pytest.approx(frame.area, rel=0.05)
    assert hypot(*np.mean(ours["visible"], axis=0)) < 0.1
