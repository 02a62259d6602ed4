"""The NavMesh by its laws, seen from Python: convex, inside its domain, and its ways as short as they can be."""

from dataclasses import replace
from math import dist, inf
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.sparse.csgraph import shortest_path
from shapely import LineString, MultiPoint, Point, Polygon

from pavetwin._core import NavMesh
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import prepare
from pavetwin.mission.mission import Mission
from pavetwin.mission.planning import choose_targets
from pavetwin.navigation.navmesh import VOXEL_M, FlightDomain, flight_domain, navmesh, polygons
from pavetwin.world.model import Furniture, FurnitureKind, Junction, World
from scenes.tiny import Scene, TinyTraffic, bent, block, straight, street, world

RADIUS_M = 0.5


def baked(domain: shapely.Geometry, radius_m: float = RADIUS_M) -> NavMesh:
    vertices, triangles = FlightDomain(10.0, domain).triangles()
    return NavMesh.bake(vertices, triangles, cell_size_m=VOXEL_M, agent_radius_m=radius_m)


def assert_laws(mesh: NavMesh, domain: shapely.Geometry, radius_m: float = RADIUS_M) -> None:
    """Convex polygons that do not overlap, inside the domain to within a voxel, and no smaller than they must be."""
    shapes = polygons(mesh)
    assert shapes
    for shape in shapes:
        assert shape.is_valid
        assert shape.exterior.is_ccw
        assert shape.convex_hull.area - shape.area < 1e-6
    surface = shapely.union_all(shapes, grid_size=1e-6)
    assert sum(shape.area for shape in shapes) == pytest.approx(surface.area, rel=1e-4)
    assert mesh.area_m2() == pytest.approx(surface.area, rel=1e-3)
    assert domain.buffer(VOXEL_M).covers(surface)
    # And it gives away no more than the radius, rasterising and straightening cost.
    core = domain.buffer(-radius_m - 3 * VOXEL_M)
    assert core.difference(surface).area <= 0.02 * core.area + 1.0


# Random scenes: streets with things in the way.


@st.composite
def domains(draw: st.DrawFn) -> shapely.Geometry:
    """Two or three streets that cross, less some convex obstacles."""
    streets = [LineString([(-40, 0), (40, draw(st.floats(-10, 10)))])]
    x = draw(st.floats(-25, 25))
    streets.append(LineString([(x, -35), (x + draw(st.floats(-15, 15)), 35)]))
    if draw(st.booleans()):
        streets.append(LineString([(-40, 20), (0, draw(st.floats(15, 30))), (40, 20)]))
    surface = shapely.union_all([line.buffer(draw(st.floats(5, 9)), cap_style="flat") for line in streets])
    for _ in range(draw(st.integers(0, 6))):
        at = np.array([draw(st.floats(-35, 35)), draw(st.floats(-30, 30))])
        corners = [at + np.array([draw(st.floats(-5, 5)), draw(st.floats(-5, 5))]) for _ in range(6)]
        surface = shapely.difference(surface, MultiPoint(corners).convex_hull)
    return max(shapely.get_parts(surface), key=lambda part: part.area)


@examples(max_examples=40)
@given(domains())
def test_polygons_are_convex_and_inside_the_domain(domain: shapely.Geometry) -> None:
    assert_laws(baked(domain), domain)


def optimum(surface: shapely.Geometry, start: tuple[float, float], goal: tuple[float, float]) -> float:
    """The shortest way over a surface: a visibility graph over its corners, and Dijkstra. Not the kernel's.

    The surface is half a millimetre narrower here: no way leads through a point at which it only touches itself.
    """
    core, free = (surface.buffer(-inset_m, join_style="mitre") for inset_m in (5e-4, 4.9e-4))
    shapely.prepare(free)
    parts = [part for part in shapely.get_parts(core) if not part.is_empty]
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    ends = [[shapely.shortest_line(Point(end), part) for part in parts] for end in (start, goal)]
    begins, arrives = ([line for line in lines if line.length < 0.01] for lines in ends)
    corners = np.vstack([*(line.coords[1:] for line in (*begins, *arrives)), *(ring.coords[:-1] for ring in rings)])
    a, b = np.triu_indices(len(corners), 1)
    lines = shapely.linestrings(np.stack([corners[a], corners[b]], axis=1))
    sees = shapely.covers(free, lines)
    graph = np.full((len(corners), len(corners)), inf)
    graph[a[sees], b[sees]] = shapely.length(lines[sees])
    count = len(begins) + len(arrives)
    ways = shortest_path(graph, directed=False, indices=range(len(begins)), method="D")[:, len(begins) : count]
    return float((ways + shapely.length(begins)[:, None] + shapely.length(arrives)).min())


@pytest.mark.slow
@examples(max_examples=40)
@given(domains(), st.data())
def test_ways_are_within_one_percent_of_the_optimum(domain: shapely.Geometry, data: st.DataObject) -> None:
    mesh = baked(domain)
    surface = shapely.union_all(polygons(mesh), grid_size=1e-6)
    free = surface.buffer(2e-3)
    for _ in range(4):
        ends = [(data.draw(st.floats(-40, 40)), data.draw(st.floats(-35, 35))) for _ in range(2)]
        start, goal = (mesh.nearest(*end) for end in ends)
        if mesh.component_of(*start) != mesh.component_of(*goal):
            with pytest.raises(PaveTwinError, match="no way leads from"):
                mesh.path(start, goal)
            continue
        way = mesh.path(start, goal)
        assert tuple(way[0]) == pytest.approx(start)
        assert tuple(way[-1]) == pytest.approx(goal)
        assert free.covers(LineString(way))
        if dist(start, goal) < 1e-3:
            continue
        best = optimum(surface, start, goal)
        length = float(np.hypot(*np.diff(way, axis=0).T).sum())
        assert dist(start, goal) - 1e-6 <= best < inf
        assert best - 0.01 <= length <= best * 1.01 + 0.01


def test_no_way_leads_through_a_point_at_which_the_mesh_touches_itself() -> None:
    """Unit squares around a free one: (0, 0) and (1, 1) share a corner only, so the way leads around all others."""
    squares = [(0, 0), (-1, 0), (-1, 1), (-1, 2), (0, 2), (1, 2), (1, 1)]
    corners = np.array([(x + i, y + j) for x, y in squares for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
    vertices, indices = np.unique(corners, axis=0, return_inverse=True)
    offsets = np.arange(0, len(corners) + 1, 4, dtype=np.uint32)
    mesh = NavMesh.from_polygons(vertices, offsets, indices.ravel().astype(np.uint32))
    start, goal = (0.5, 0.9), (1.1, 1.4)
    around = dist(start, (0, 1)) + 1 + 1 + dist((1, 2), goal)
    way = mesh.path(start, goal)
    assert float(np.hypot(*np.diff(way, axis=0).T).sum()) == pytest.approx(around, abs=1e-6)
    assert optimum(shapely.union_all(polygons(mesh)), start, goal) == pytest.approx(around, abs=0.01)


@examples(max_examples=40)
@given(domains(), st.floats(-60, 60), st.floats(-60, 60))
def test_the_nearest_point_is_the_nearest_point(domain: shapely.Geometry, x: float, y: float) -> None:
    mesh = baked(domain)
    surface = shapely.union_all(polygons(mesh), grid_size=1e-6)
    place = mesh.nearest(x, y)
    assert mesh.contains(*place)
    assert mesh.component_of(*place) is not None
    assert dist(place, (x, y)) == pytest.approx(surface.distance(shapely.Point(x, y)), abs=1e-3)


@pytest.mark.parametrize("radius_m", [0.3, 0.5, 1.5])
@pytest.mark.parametrize("altitude_m", [6.0, 15.0])
def test_a_whole_world_keeps_the_laws(altitude_m: float, radius_m: float) -> None:
    houses = [block("a", 20, 3, 34, 20, 12.0), block("b", 60, 8, 70, 40, 5.0)]
    town = replace(bent(), buildings=tuple(houses))
    mesh = navmesh(town, altitude_m, radius_m)
    assert_laws(mesh, flight_domain(town, altitude_m).surface, radius_m)


def test_a_mesh_is_the_same_whenever_it_is_baked() -> None:
    first, second = navmesh(bent(), 10.0, 0.5), navmesh(bent(), 10.0, 0.5)
    assert np.array_equal(first.vertices(), second.vertices())
    assert np.array_equal(first.corners(), second.corners())
    assert np.array_equal(first.offsets(), second.offsets())


# The domain at an altitude.


def surface_at(town: World, altitude_m: float) -> shapely.Geometry:
    return flight_domain(town, altitude_m).surface


def test_the_domain_is_the_corridor_of_the_streets_and_four_metres() -> None:
    surface = surface_at(straight(), 10.0)
    assert surface.bounds == pytest.approx((-4.0, -7.5, 64.0, 7.5), abs=0.03)
    assert surface.area == pytest.approx(68 * 15 - (4 - np.pi) * 16, rel=0.01)  # round corners


@pytest.mark.parametrize(
    ("altitude_m", "is_free"), [(6.0, False), (12.0, False), (12.99, False), (13.01, True), (30.0, True)]
)
def test_a_building_is_in_the_way_up_to_a_metre_above_its_roof(altitude_m: float, is_free: bool) -> None:
    town = straight(buildings=[block("house", 25, 2, 35, 20, 12.0)])
    surface = surface_at(town, altitude_m)
    assert surface.covers(shapely.Point(30, 5)) == is_free
    assert surface.covers(shapely.Point(30, 0))


@pytest.mark.parametrize(
    ("altitude_m", "is_free"), [(5.5, True), (6.9, True), (7.1, False), (10.0, False), (12.9, False), (13.1, True)]
)
def test_a_tree_is_in_the_way_where_its_crown_is(altitude_m: float, is_free: bool) -> None:
    """Its crown is 3 m wide from 8 to 12 m; below there is but the trunk, 0.2 m from its middle."""
    tree = Furniture("t", FurnitureKind.TREE, shapely.Point(30, 0), 12.0, 1.5, clear_height_m=8.0)
    surface = surface_at(replace(straight(), furniture=(tree,)), altitude_m)
    beside = shapely.Point(31.0, 0)
    assert surface.covers(beside) == is_free
    assert surface.covers(shapely.Point(30.0, 0.0)) == (altitude_m > 13)
    assert surface.covers(shapely.Point(32.0, 0))


def test_a_lamps_arm_is_in_the_way_at_its_own_height_only() -> None:
    lamp = Furniture("l", FurnitureKind.STREET_LIGHT, shapely.Point(30, 6), 8.0, 0.1, yaw_rad=-np.pi / 2, arm_m=4.0)
    town = replace(straight(), furniture=(lamp,))
    below_arm = shapely.Point(30.0, 3.0)
    assert surface_at(town, 6.0).covers(below_arm)
    assert not surface_at(town, 7.5).covers(below_arm)
    assert not surface_at(town, 9.0).covers(below_arm)
    assert surface_at(town, 9.5).covers(below_arm)
    assert not surface_at(town, 6.0).covers(shapely.Point(30, 6))


@pytest.mark.parametrize("altitude_m", [0.0, -5.0, 4.9, 120.1, float("nan"), inf])
def test_an_altitude_where_the_uav_may_not_fly_is_one_plain_error(altitude_m: float) -> None:
    with pytest.raises(PaveTwinError, match=r"`altitude_m` .*: the UAV flies at \d+ m or (higher|lower)") as caught:
        flight_domain(straight(), altitude_m)
    assert "\n" not in str(caught.value)


def test_a_street_that_is_built_over_is_one_plain_error() -> None:
    covered = straight(buildings=[block("hall", -20, -20, 80, 20, 9.0)])
    with pytest.raises(PaveTwinError, match="no flight domain is left over 'tiny'") as caught:
        prepare(covered, Scene(covered).settings())
    assert "\n" not in str(caught.value)
    assert flight_domain(covered, 15.0).surface.area > 900


def test_a_gap_too_narrow_for_the_uav_is_one_plain_error() -> None:
    """The gap between the buildings is narrower than the UAV."""
    walls = [block("a", -20, -20, 80, -0.3, 30.0), block("b", -20, 0.3, 80, 20, 30.0)]
    narrow = straight(buildings=walls)
    with pytest.raises(PaveTwinError, match=r"agent radius of 0\.5 m") as caught:
        prepare(narrow, Scene(narrow, altitude_m=10.0).settings())
    assert "\n" not in str(caught.value)


# A segment that cannot be reached.


def two_islands() -> World:
    """The base lies next to one street; no way leads to the other."""
    return world([street("here", (0, 0), (60, 0)), street("there", (0, 100), (60, 100))], base=(-2, 0))


def test_a_segment_that_cannot_be_reached_is_one_plain_error() -> None:
    settings = Scene(two_islands()).settings()
    environment = prepare(two_islands(), settings)
    assert [environment.reachable(index) for index in range(2)] == [True, False]
    with pytest.raises(PaveTwinError, match=r"`names` there: no way leads there from the base at 6 m"):
        choose_targets(environment, names=["here", "there"])
    with pytest.raises(PaveTwinError, match="only 1 of the 2 segments of 'tiny' can be reached"):
        choose_targets(environment, count=2)
    assert choose_targets(environment) == [0]
    mission = Mission(environment, TinyTraffic(), settings, [1])
    with pytest.raises(PaveTwinError, match="No way leads from the base to segment 'there'"):
        list(mission)


def test_a_base_without_any_segment_in_reach_is_one_plain_error() -> None:
    town = world(
        [street("there", (0, 100), (60, 100))], junctions=[Junction("x", "x", _box(-5, -5, 5, 5))], base=(0, 0)
    )
    environment = prepare(town, Scene(town).settings())
    with pytest.raises(PaveTwinError, match="No segment of 'tiny' can be reached from the base"):
        choose_targets(environment)


def _box(west: float, south: float, east: float, north: float) -> Polygon:
    shape = shapely.box(west, south, east, north)
    assert isinstance(shape, Polygon)
    return shape


@pytest.mark.parametrize(("count", "order"), [(0, "random"), (-1, "near"), (3, "sideways")])
def test_targets_that_make_no_sense_are_one_plain_error(count: int, order: str) -> None:
    environment = prepare(bent(), Scene(bent()).settings())
    with pytest.raises(PaveTwinError, match=r"`count`|`order`"):
        choose_targets(environment, count=count, order=order)


def test_targets_are_drawn_by_the_seed_or_toured() -> None:
    segments = [street(f"s{k}", (70 * k, 0), (70 * k + 60, 0)) for k in range(6)]
    links = [Junction(f"j{k}", "x", _box(70 * k + 60, -3, 70 * k + 70, 3)) for k in range(5)]
    town = world(segments, junctions=links)
    environment = prepare(town, Scene(town).settings())
    drawn = {seed: choose_targets(environment, seed=seed) for seed in range(8)}
    assert all(sorted(targets) == list(range(6)) for targets in drawn.values())
    assert len({tuple(targets) for targets in drawn.values()}) > 5
    assert choose_targets(environment, seed=0) == drawn[0] != drawn[1]
    assert choose_targets(environment, count=3, seed=2) == drawn[2][:3]
    assert choose_targets(environment, order="near") == list(range(6))
    assert choose_targets(environment, names=["s4", "s1"]) == [4, 1]
    assert choose_targets(environment, names=["s4", "s1"], order="near") == [1, 4]
    with pytest.raises(PaveTwinError, match=r"`count` 9: 'tiny' has only 6; choose fewer, or all"):
        choose_targets(environment, count=9)
    with pytest.raises(PaveTwinError, match="no segment or street 's44'"):
        choose_targets(environment, names=["s44"])


# Kept in the cache.


def test_a_mesh_is_kept_in_the_cache_and_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path / "cache"))
    town = replace(bent(), content_hash="abc", folder=tmp_path / "town")
    folder = tmp_path / "cache" / "worlds" / "abc" / "navmesh"
    first = navmesh(town, 10.0, 0.5)
    kept = list(folder.iterdir())
    assert len(kept) == 1
    again = navmesh(town, 10.0, 0.5)
    assert np.array_equal(first.vertices(), again.vertices())
    assert first.path((0, 0), (100, 60)) == pytest.approx(again.path((0, 0), (100, 60)))
    navmesh(town, 12.0, 0.5)
    navmesh(town, 10.0, 0.6)
    assert len(list(folder.iterdir())) == 3
    whole = kept[0].read_bytes()
    torn = whole[:400] + bytes(255 - byte for byte in whole[400:450]) + whole[450:]
    for damage in (b"", b"PK\x03\x04 no", b"\x93NUMPY", whole[:200], whole[:-30], torn):
        kept[0].write_bytes(damage)
        assert navmesh(town, 10.0, 0.5).area_m2() == pytest.approx(first.area_m2())
