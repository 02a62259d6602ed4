"""Cracks that start at covers and patches or run along trenches: where they may lie, and what scenes draw there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pavetwin.defects import DefectOptions, place
from pavetwin.defects.context import COVER_ROOM_M, Feature, room_for, start_of
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground.distractors.fixtures import REACH_M
from pavetwin.scene.ground.distractors.plants import plants
from pavetwin.scene.ground.markings.painter import Painter
from pavetwin.scene.ground.markings.standard import paint
from pavetwin.scene.ground.plan import plan_ground
from pavetwin.scene.patches import holes_of
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import built

CRACKS = """
title: cracks that start at something
density: {per_100_m2: 6}
classes:
  single_crack:
    weight: 1
    sizes: {length_m: {median: 0.8, sigma: 0.2, least: 0.5, most: 1.2}}
    context: {cover: 0.4, patch: 0.3, trench: 0.3, overgrown: 0.5}
"""


@pytest.fixture(scope="module")
def cracked(tmp_path_factory: pytest.TempPathFactory) -> World:
    file = tmp_path_factory.mktemp("population") / "cracks.yaml"
    file.write_text(CRACKS)
    town = built("cross").world
    return replace(town, defects=place(town.segments[:3], 5, DefectOptions(population=str(file))))


@pytest.fixture(scope="module")
def plan(cracked: World):  # type: ignore[no-untyped-def]
    return plan_ground(cracked, 1, holes_of(cracked.defects))


def of(world: World, feature: Feature):  # type: ignore[no-untyped-def]
    return [defect for defect in world.defects if defect.beside == feature]


def test_covers_have_room_on_the_asphalt_that_no_other_defect_touches(cracked: World) -> None:
    covers = of(cracked, Feature.COVER)
    assert len(covers) > 3
    outlines = shapely.STRtree([defect.polygon for defect in cracked.defects])
    for defect in covers:
        room = room_for(Feature.COVER, defect.polygon, defect.yaw_rad)
        assert room is not None
        assert cracked.segment(defect.segment).polygon.contains(room)
        touched = outlines.query(room.buffer(-0.01), "intersects").tolist()
        assert set(touched) <= {defect.id}


def test_a_scene_has_a_cover_at_the_end_of_each_crack_that_starts_at_one(cracked: World, plan) -> None:  # type: ignore[no-untyped-def]
    covers = [each for each in plan.fixtures if each.model.startswith("cover")]
    for defect in of(cracked, Feature.COVER):
        start, away = start_of(defect.polygon, defect.yaw_rad)
        gaps = [np.hypot(*(start - (each.x, each.y))) - REACH_M[each.model] for each in covers]
        nearest = covers[int(np.argmin(np.abs(gaps)))]
        assert 0 < min(gaps, key=abs) < 0.1
        assert (np.array([nearest.x, nearest.y]) - start) @ away > 0.99 * (REACH_M[nearest.model])
    assert max(REACH_M[each.model] for each in covers) < COVER_ROOM_M


def test_patches_have_a_corner_at_their_crack_and_trenches_an_edge(cracked: World, plan) -> None:  # type: ignore[no-untyped-def]
    rings = [_ring(patch) for patch in plan.patches]
    for defect in of(cracked, Feature.PATCH):
        start, _ = start_of(defect.polygon, defect.yaw_rad)
        assert min(np.hypot(*(ring - start).T).min() for ring in rings) < 1e-6
    for defect in of(cracked, Feature.TRENCH):
        edges = [shapely.Polygon(ring).exterior for ring in rings]
        assert min(edge.distance(defect.centre) for edge in edges) < 1e-6


def _ring(patch: np.ndarray) -> np.ndarray:
    x, y, turn, long, wide, _ = patch
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (long, wide)
    return corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + (x, y)


def test_plants_grow_in_overgrown_cracks_only(cracked: World, plan) -> None:  # type: ignore[no-untyped-def]
    none = Painter().done()
    tufts = plants(plan, none).bars
    assert len(tufts) > len(cracked.defects)
    outlines = shapely.union_all([defect.polygon for defect in cracked.defects])
    assert shapely.dwithin(outlines, shapely.points(tufts[:, :2]), 0.02).all()
    bare = tuple(replace(each, parameters=()) for each in cracked.defects)
    assert not len(plants(replace(plan, world=replace(cracked, defects=bare)), none).bars)
    assert (plan.paint.bar_looks[:, 0] > paint("green")).any()


def test_what_a_crack_starts_at_is_stored_and_counts_as_content(cracked: World, tmp_path: Path) -> None:
    town = built("cross")
    some = replace(town.world, defects=cracked.defects[:6])
    save_world(replace(town, world=some), tmp_path / "town")
    again = load_world(tmp_path / "town")
    assert [each.beside for each in again.defects] == [each.beside for each in some.defects]
    assert again.defects_hash == some.defects_hash
    plain = tuple(replace(each, beside="") for each in some.defects)
    assert replace(some, defects=plain).defects_hash != some.defects_hash


def test_shares_that_sum_to_more_than_all_are_one_line(tmp_path: Path) -> None:
    file = tmp_path / "cracks.yaml"
    file.write_text(CRACKS.replace("trench: 0.3", "trench: 0.4"))
    with pytest.raises(PaveTwinError, match=r"context: the shares of cover, patch and trench sum to more than 1"):
        DefectOptions(population=str(file)).effective()
