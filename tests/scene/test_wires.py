"""Overhead wires and bare trees: between poles and to houses, and the strips of ground that they shade."""

from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Point

from pavetwin.scene.branches import FORMS, bare_tree_of, bare_trees, skeleton
from pavetwin.scene.ground.styles.street_style import Overhead
from pavetwin.scene.scene import Scene, keys_of
from pavetwin.scene.values import TILE_M
from pavetwin.scene.wires import EAVES_M, Wires, shaded_strips, wires_of
from pavetwin.world.model import Furniture, FurnitureKind, World
from scenes import tiny

WIRED = Overhead(wired=1.0, connections=1.0)
SUN = np.array([-0.6, 0.0, 0.8])
"""In the west, 53° high."""


def pole(name: str, x: float, y: float = -4.1) -> Furniture:
    return Furniture(name, FurnitureKind.POLE, Point(x, y), 9.0, 0.12)


@cache
def world(*, blocked: bool = False) -> World:
    """The usual street with four poles on one side, one on the other, and a house across."""
    houses = [tiny.block("across", 10.0, 8.0, 22.0, 16.0, 8.0)]
    houses += [tiny.block("between", 26.0, -6.0, 30.0, -4.0, 6.0)] if blocked else []
    poles = [pole("a", 2.0), pole("b", 20.0), pole("c", 38.0), pole("d", 56.0), pole("e", 30.0, 4.1)]
    trees = [
        Furniture(f"t{k}", FurnitureKind.TREE, Point(5.0 + 10 * k, -7.0), 8.0, 2.5, clear_height_m=3.0)
        for k in range(5)
    ]
    return tiny.world([tiny.street("street", (0, 0), (60, 0))], buildings=houses, furniture=[*poles, *trees])


def ends(found: Wires) -> np.ndarray:
    """(n, 3) where wires are tied: ends of pieces that no other piece continues."""
    points = np.round(np.concatenate([found.pieces[:, :3], found.pieces[:, 3:6]]), 6)
    unique, count = np.unique(points, axis=0, return_counts=True)
    return unique[count == 1]


def test_wires_run_from_pole_to_pole_and_hang_between_them() -> None:
    found = wires_of(world(), Overhead(wired=1.0), 3)
    assert not len(wires_of(world(), Overhead(), 3).pieces)
    poles = shapely.MultiPoint([item.position for item in world().furniture if item.kind is FurnitureKind.POLE])
    tied = ends(found)
    assert {round(float(x)) for x in tied[:, 0]} == {2, 56}, "the pole across has none beside it"
    assert shapely.distance(shapely.points(tied[:, :2]), poles).max() < 0.5
    assert shapely.distance(shapely.points(found.pieces[:, :2]), Point(20.0, -4.1)).min() < 0.5
    assert tied[:, 2].min() > 6.0
    assert found.pieces[:, [2, 5]].min() < tied[:, 2].min() - 0.1
    assert len(found.arms) == 4


def test_no_wire_runs_through_a_house() -> None:
    found = wires_of(world(blocked=True), Overhead(wired=1.0), 3)
    lines = [shapely.LineString(row.reshape(2, 2)) for row in found.pieces[:, [0, 1, 3, 4]]]
    assert lines
    assert not shapely.union_all(lines).intersects(world(blocked=True).buildings[1].polygon)


def test_houses_are_connected_over_the_street() -> None:
    plain, found = (wires_of(world(), rules, 3) for rules in (Overhead(wired=1.0), WIRED))
    assert len(found.pieces) > len(plain.pieces)
    at_house = ends(found)[ends(found)[:, 1] > 7.9]
    assert len(at_house) > 1
    assert at_house[:, 2] == pytest.approx(EAVES_M)


def test_the_same_seed_hangs_the_same_wires() -> None:
    first, again, other = (wires_of(world(), WIRED, seed).pieces for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_every_piece_is_on_one_tile_and_thin_things_need_no_shadow_map() -> None:
    scene = Scene(world(), seed=3)
    tiles = [scene.tile(key) for key in keys_of((-8.0, -12.0, 68.0, 20.0))]
    twigs = sum(len(skeleton(0)) for tile in tiles for each in tile.instances if each.model.startswith("bare_"))
    found = np.concatenate([tile.thin for tile in tiles])
    assert len(found) == len(wires_of(world(), scene._street_style.overhead, 3).pieces) + twigs > 0
    for tile in tiles:
        middle = (tile.thin[:, :2] + tile.thin[:, 3:5]) / 2
        if not any(each.model.startswith("bare_") for each in tile.instances):
            np.testing.assert_array_equal(np.floor(middle / TILE_M), np.tile(tile.key, (len(middle), 1)))


def test_a_bare_tree_stays_in_its_crown() -> None:
    item = Furniture("t", FurnitureKind.TREE, Point(3.0, 4.0), 9.0, 2.5, clear_height_m=3.0)
    for form in range(FORMS):
        _, rows = bare_tree_of(item, 0.12, form, 1.0)
        points = np.concatenate([rows[:, :3], rows[:, 3:6]])
        assert np.hypot(points[:, 0] - 3.0, points[:, 1] - 4.0).max() <= 2.5
        assert points[:, 2].min() == pytest.approx(0.12)
        assert points[:, 2].max() <= 9.0
        assert rows[:, 6].min() > 0.003
        mesh = bare_trees()[f"bare_{form}"].parts["body"]
        assert len(mesh.indices) == 10 * len(rows)


def test_strips_follow_the_ground_over_a_kerb() -> None:
    wire = np.array([[-6.0, 0.0, 8.0, 6.0, 0.0, 8.0, 0.01]])
    strips = shaded_strips(wire, SUN, lambda xy: np.where(np.asarray(xy)[:, 0] > 4.0, 0.12, 0.0))
    np.testing.assert_allclose(strips[:, 7], [0.0, 0.12])
    np.testing.assert_allclose(strips[0, :3], wire[0, :3])
    np.testing.assert_allclose(strips[1, 3:6], wire[0, 3:6])
    np.testing.assert_allclose(strips[0, 3:6], strips[1, :3])
    edge = strips[1, 0] + 0.6 / 0.8 * (8.0 - 0.12)
    assert edge == pytest.approx(4.0, abs=0.3)


def test_shadows_too_far_from_their_wire_are_left_out() -> None:
    low = np.array([-np.cos(0.1), 0.0, np.sin(0.1)])
    wire = np.array([[0.0, -5.0, 8.0, 0.0, 5.0, 8.0, 0.01]])
    assert not len(shaded_strips(wire, low, lambda xy: np.zeros(len(np.asarray(xy)))))


def test_another_light_makes_no_tile_again() -> None:
    scene = Scene(world(), seed=3)
    for sun in (SUN, np.array([0.6, 0.0, 0.8])):
        assert len(np.concatenate([scene.strips_on(key, sun) for key in keys_of((0.0, -12.0, 60.0, 20.0))]))
    assert scene._tile.cache_info().misses == 0
