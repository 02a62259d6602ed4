"""Tiles: the ground and the patches cover every square once, nothing is lost between them, order does not matter."""

from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Point

from pavetwin.defects import DefectOptions, place
from pavetwin.scene.furniture import APART_M, FROM_ROAD_M, HIGHEST_M, StreetObjects
from pavetwin.scene.meshes import bounds
from pavetwin.scene.scene import Scene
from pavetwin.scene.shafts import SHAFT
from pavetwin.scene.values import TILE_M, Instance, Mesh, Tile
from pavetwin.world.model import Building, Furniture, FurnitureKind, LaneKind, World
from pavetwin.world.solids import SolidKind, furniture_prisms
from scenes import built, tiny

KEYS = ((0, -1), (0, 0), (1, -1), (1, 0))


@cache
def world() -> World:
    """A street of 60 m full of defects, a house across a tile's edge, a tree, a light and a sign."""
    street = tiny.street("street", (0.0, 0.0), (60.0, 0.0))
    return tiny.world(
        [street],
        place([street], 5, DefectOptions(population="paper", per_segment=25)),
        buildings=[tiny.block("wide", 20.0, 12.0, 40.0, 24.0, 8.0)],
        furniture=[
            Furniture("tree", FurnitureKind.TREE, Point(10, 6), 9.3, 2.7, clear_height_m=3.1),
            Furniture("light", FurnitureKind.STREET_LIGHT, Point(31, -4.1), 8.0, 0.1, np.pi / 2, 1.5),
            Furniture("sign", FurnitureKind.SIGN, Point(55, -4.0), 2.5, 0.05, np.pi / 2),
            Furniture("signal", FurnitureKind.SIGNAL, Point(50, 4.3), 6.0, 0.12, -np.pi / 2, 5.0, controller="c"),
            Furniture("pole", FurnitureKind.POLE, Point(5, -4.2), 9.0, 0.12),
        ],
    )


@cache
def scene() -> Scene:
    return Scene(world(), seed=4)


def plan_area(mesh: Mesh) -> float:
    corners = mesh.positions[mesh.indices].astype(float)
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0])[:, :2].T, (corners[:, 2] - corners[:, 0])[:, :2].T
    return float((ax * by - ay * bx).sum() / 2)


def points_of(instance: Instance) -> np.ndarray:
    """(n, 3) vertices in the world frame."""
    mesh = scene().models[instance.model].parts[instance.part]
    return mesh.positions.astype(float) @ instance.transform[:3, :3].T + instance.transform[:3, 3]


def test_ground_and_patches_cover_the_tiles_once_over() -> None:
    """A part of a patch may reach over its tile's edge, where its neighbour's reaches less: the sum is what counts."""
    tiles = [scene().tile(key) for key in KEYS]
    total = sum(plan_area(piece.mesh) for tile in tiles for piece in tile.ground)
    filled = sum(plan_area(patch.mesh) for tile in tiles for patch in scene().patches_on(tile.key))
    assert filled > 10.0
    assert total + filled == pytest.approx(len(KEYS) * TILE_M**2, rel=1e-5)


def test_every_defect_has_its_patch_in_whole() -> None:
    labels: dict[int, float] = {}
    for key in KEYS:
        for patch in scene().patches_on(key):
            labels[patch.label] = labels.get(patch.label, 0.0) + plan_area(patch.mesh)
    assert len(labels) == len(world().defects)


def test_the_ground_has_no_step_at_the_rim_of_a_hole() -> None:
    """The ground's corners on a hole's ring lie where the patch's border does."""
    tile = scene().tile((0, 0))
    ground = np.concatenate([piece.mesh.positions for piece in tile.ground]).astype(float)
    found = 0
    for patch in scene().patches_on((0, 0)):
        points = patch.mesh.positions.astype(float) @ patch.transform[:3, :3].T + patch.transform[:3, 3]
        near = np.linalg.norm(ground[:, None, :2] - points[None, :, :2], axis=2) < 1e-4
        pairs = np.argwhere(near)
        assert np.abs(ground[pairs[:, 0], 2] - points[pairs[:, 1], 2]).max(initial=0) < 1e-6
        found += len(pairs)
    assert found > 50


def test_order_and_forgetting_do_not_matter() -> None:
    forgetful = Scene(world(), seed=4, tiles_kept=1)
    for key in reversed(KEYS):
        same(forgetful.tile(key), scene().tile(key))
        mine, theirs = forgetful.maps(key), scene().maps(key)
        assert np.array_equal(mine.weathering, theirs.weathering)
        assert np.array_equal(mine.drawn, theirs.drawn)
        for one, other in zip(forgetful.patches_on(key), scene().patches_on(key), strict=True):
            assert np.array_equal(one.mesh.positions, other.mesh.positions)
            assert np.array_equal(one.relief, other.relief)


def same(a: Tile, b: Tile) -> None:
    assert a.key == b.key
    for mine, theirs in zip([*a.ground, *a.facades], [*b.ground, *b.facades], strict=True):
        assert np.array_equal(mine.mesh.positions, theirs.mesh.positions)
    for mine, theirs in zip(a.instances, b.instances, strict=True):
        assert mine.model == theirs.model
        assert np.array_equal(mine.transform, theirs.transform)
        assert np.array_equal(mine.tints, theirs.tints)


def test_the_nearest_tiles_come_first_and_leaning_houses_count() -> None:
    keys = scene().keys_near(10.0, 10.0, 30.0)
    assert keys[0] == (0, 0)
    assert set(KEYS) <= set(keys)
    # The house's middle lies at x = 30 in tile (0, 0); its east side reaches to x = 40.
    assert (0, 0) in scene().keys_near(44.0, 18.0, 6.0)
    assert (0, 0) not in scene().keys_near(60.0, 18.0, 6.0)
    assert sum(len(scene().tile(key).facades) > 0 for key in KEYS) == 1


def test_tiles_are_kept_as_many_as_asked() -> None:
    small = Scene(world(), seed=4, tiles_kept=2)
    first = small.tile((0, 0))
    assert small.tile((0, 0)) is first
    small.tile((1, 0))
    small.tile((0, -1))
    assert small.tile((0, 0)) is not first


def furniture_of(name: str) -> tuple[Furniture, list[Instance]]:
    thing = next(thing for thing in world().furniture if thing.id == name)
    key = (int(thing.position.x // TILE_M), int(thing.position.y // TILE_M))
    reach = max(thing.arm_m, 0.3) + 0.3
    found = [
        instance
        for instance in scene().tile(key).instances
        if thing.position.distance(Point(instance.transform[:2, 3])) < reach and instance.model in HELD[thing.kind]
    ]
    return thing, found


HELD = {
    FurnitureKind.TREE: {f"tree_{form}" for form in ("oval", "round", "spreading", "young")},
    FurnitureKind.STREET_LIGHT: {SHAFT, "lamp_head"},
    FurnitureKind.SIGN: {SHAFT, "sign_round", "sign_triangle", "sign_octagon"},
    FurnitureKind.SIGNAL: {SHAFT},
    FurnitureKind.POLE: {SHAFT},
}


def test_a_tree_has_its_own_crown_and_height() -> None:
    thing, (crown, trunk) = furniture_of("tree")
    leaves, wood = points_of(crown), points_of(trunk)
    assert leaves[:, 2].min() == pytest.approx(thing.clear_height_m, abs=0.02)
    assert leaves[:, 2].max() == pytest.approx(thing.height_m, abs=0.02)
    radius = np.hypot(leaves[:, 0] - thing.position.x, leaves[:, 1] - thing.position.y)
    assert np.quantile(radius, 0.99) == pytest.approx(thing.radius_m, rel=0.12)
    assert wood[:, 2].min() < 0.15
    assert wood[:, 2].max() < thing.height_m


@pytest.mark.parametrize("name", ["light", "sign", "signal", "pole"])
def test_masts_and_arms_agree_with_the_solids(name: str) -> None:
    thing, instances = furniture_of(name)
    prisms = dict(furniture_prisms(thing))
    mast = next(each for each in instances if each.part in ("straight", "tapered"))
    points = points_of(mast)
    ring, _, top = prisms[SolidKind.MAST]
    assert points[:, 2].max() == pytest.approx(top, abs=0.01)
    assert shapely.distance(shapely.Polygon(ring), shapely.points(points[:, :2])).max() < 0.01
    if thing.arm_m:
        base, low, high = prisms[SolidKind.ARM]
        arm = np.concatenate([points_of(each) for each in instances if each is not mast])
        assert shapely.distance(shapely.Polygon(base), shapely.points(arm[:, :2])).max() < 0.08
        assert low - 0.02 <= arm[:, 2].min() <= arm[:, 2].max() <= high + 0.02
        reach = np.hypot(arm[:, 0] - thing.position.x, arm[:, 1] - thing.position.y).max()
        assert reach == pytest.approx(thing.arm_m, abs=0.05)
    if name == "sign":
        plate = points_of(next(each for each in instances if each.model != SHAFT))
        base, low, high = prisms[SolidKind.SIGN]
        assert shapely.distance(shapely.Polygon(base), shapely.points(plate[:, :2])).max() < 0.06
        assert low - 0.15 < plate[:, 2].min()
        assert plate[:, 2].max() < high + 0.05


def test_extras_stand_low_and_clear_of_walks_and_roads() -> None:
    town = built("town").world
    extras = StreetObjects(town, seed=0).extras()
    assert len(extras) > 40
    assert {extra.model for extra in extras} >= {"bin", "bench", "bicycle", "bollard"}
    places = np.array([Point(extra.x_m, extra.y_m) for extra in extras], dtype=object)
    assert shapely.distance(town.carriageway, places).min() >= FROM_ROAD_M
    walks = [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in town.lanes_of(LaneKind.SIDEWALK)]
    assert not shapely.intersects(shapely.union_all(walks), places).any()
    houses = shapely.union_all([house.polygon for house in town.buildings])
    assert shapely.distance(houses, places).min() > 0.1
    things = shapely.union_all([thing.position for thing in town.furniture])
    assert shapely.distance(things, places).min() > APART_M
    models = scene().models
    assert max(bounds(models[extra.model].parts["body"])[1][2] for extra in extras) < HIGHEST_M


def test_a_world_with_nothing_but_a_street_is_a_scene() -> None:
    bare = Scene(tiny.straight(), seed=0)
    tile = bare.tile((0, 0))
    assert tile.facades == ()
    assert tuple(bare.patches_on((0, 0))) == ()
    assert sum(plan_area(piece.mesh) for piece in tile.ground) == pytest.approx(TILE_M**2, rel=1e-5)
    assert bare.agents(None, 0.0) == ()


def test_a_house_alone_stands_in_the_tile_of_its_middle() -> None:
    house = Building("b", shapely.box(30.0, 10.0, 40.0, 18.0), 7.0)
    lone = Scene(tiny.world([tiny.street("s", (0.0, 0.0), (60.0, 0.0))], buildings=[house]), seed=0)
    assert len(lone.tile((1, 0)).facades) > 0
    assert lone.tile((0, 0)).facades == ()
    points = np.concatenate([piece.mesh.positions for piece in lone.tile((1, 0)).facades])
    assert points[:, 0].min() == pytest.approx(30.0 - TILE_M, abs=0.45)
