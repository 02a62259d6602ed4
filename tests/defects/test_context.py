"""Cracks that start at covers and patches or run along trenches: where they may lie, and what scenes draw there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import LineString, Point

from pavetwin.defects import DefectOptions, place
from pavetwin.defects.context import COVER_ROOM_M, Feature, room_for, start_of
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground.distractors.crack_features import SlabCracks
from pavetwin.scene.ground.distractors.fixtures import REACH_M
from pavetwin.scene.ground.distractors.plants import EDGE_WIDTH_M, GROWS_FROM_AGE, edge_plants, plants
from pavetwin.scene.ground.ground_plan import plan_ground
from pavetwin.scene.ground.markings.painter import Painter, paint
from pavetwin.scene.ground.styles import street_style
from pavetwin.scene.patches import holes_of
from pavetwin.world.model import Defect, World
from pavetwin.world.pavement_joints import (
    SLAB_M,
    has_slabs,
    is_paved_apart,
    joints_across,
    joints_along,
    lane_joints,
    slab_width_m,
)
from pavetwin.world.segments import direction_at, point_at
from pavetwin.world.store import load_world, save_world
from scenes import built, tiny

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
    dirt = plan.style.dirt.model_copy(update={"plants": 0.0})
    plan = replace(plan, style=plan.style.model_copy(update={"dirt": dirt}))
    tufts = plants(plan, none).bars
    assert len(tufts) > len(cracked.defects)
    outlines = shapely.union_all([defect.polygon for defect in cracked.defects])
    assert shapely.dwithin(outlines, shapely.points(tufts[:, :2]), 0.02).all()
    bare = tuple(replace(each, parameters=()) for each in cracked.defects)
    assert not len(plants(replace(plan, world=replace(cracked, defects=bare)), none).bars)
    assert (plan.paint.bar_paints[:, 0] > paint("green")).any()


def on_street(name: str, per_100_m2: float, context: str, folder: Path) -> World:
    """The first segment's street of the cross under another name, with cracks on it."""
    file = folder / "joints.yaml"
    file.write_text(
        CRACKS.replace("100_m2: 6", f"100_m2: {per_100_m2}").split("    context")[0] + f"    context: {context}"
    )
    town = built("cross").world
    first = town.segments[0]
    streets = tuple(replace(each, name=name) if each.edges == first.edges else each for each in town.streets)
    segments = tuple(replace(each, street=name) if each.edges == first.edges else each for each in town.segments)
    defects = place([segments[0]], 5, DefectOptions(population=str(file)))
    return replace(town, streets=streets, segments=segments, defects=defects)


def in_street(world: World) -> list[tuple[float, float, float]]:
    """Station, offset to the left and |cos| of the angle to the street of each defect."""
    found = []
    for defect in world.defects:
        line = world.segments[0].centre_line
        station = line.project(defect.centre)
        (dx, dy), (x, y) = direction_at(line, station), point_at(line, station)
        left = (defect.centre.y - y) * dx - (defect.centre.x - x) * dy
        found.append((station, left, abs(np.cos(defect.yaw_rad) * dx + np.sin(defect.yaw_rad) * dy)))
    return found


def test_cracks_run_along_joints_between_slabs_and_scenes_draw_these(tmp_path: Path) -> None:
    name = next(name for number in range(99) if has_slabs(name := f"Slab Road {number}"))
    world = on_street(name, 2.0, "{slab_joint: 1.0}", tmp_path)
    segment, cracks = world.segments[0], in_street(world)
    across, along = joints_across(segment), joints_along(segment)
    lie_across = [(station, left) for station, left, cos in cracks if cos < 0.1]
    lie_along = [left for _, left, cos in cracks if cos > 0.9]
    assert len(cracks) == len(lie_across) + len(lie_along) == len(of(world, Feature.SLAB_JOINT)) > 8
    assert min(len(lie_across), len(lie_along)) > 1
    assert max(min(abs(across - station)) for station, _ in lie_across) < 0.01
    assert max(min(abs(along - left)) for left in lie_along) < 0.01
    plan = plan_ground(world, 1, holes_of(world.defects), street_style("varied"))
    assert plan.pavement(plan.streets[0]).slabs is not None
    seals = shapely.MultiLineString([LineString(line) for line in plan.repairs.seals])
    ends = [end for defect in world.defects for end in _ends(defect)]
    assert np.median([seals.distance(end) for end in ends]) < 0.12  # the joint goes on where the crack ends
    moved = SlabCracks.of(plan, segment).across(joints_across(segment, 7.0))
    assert all(min(abs(moved - station)) < 0.01 for station, _ in lie_across)


def _ends(defect: Defect) -> tuple[Point, Point]:
    corners = shapely.get_coordinates(defect.polygon)
    along = corners @ (np.cos(defect.yaw_rad), np.sin(defect.yaw_rad))
    return Point(corners[along.argmin()]), Point(corners[along.argmax()])


def test_cracks_run_along_joints_between_lanes_of_two_tones(tmp_path: Path) -> None:
    name = next(name for number in range(99) if is_paved_apart(name := f"Lane Road {number}"))
    world = on_street(name, 2.0, "{lane_joint: 1.0}", tmp_path)
    segment, cracks = world.segments[0], in_street(world)
    joints = lane_joints(segment)
    assert len(cracks) == len(of(world, Feature.LANE_JOINT)) > 4
    assert max(min(abs(joints - left)) for _, left, _ in cracks) < 0.01
    assert min(cos for _, _, cos in cracks) > 0.99
    plan = plan_ground(world, 1, holes_of(world.defects))
    for defect, (_, left, _) in zip(world.defects, cracks, strict=True):
        side = np.array([-np.sin(defect.yaw_rad), np.cos(defect.yaw_rad)])
        tones = [plan.paved_at(*(np.array(defect.centre.coords[0]) + away * side)).shade for away in (-0.6, 0.6)]
        assert tones[0] != tones[1], left


def test_corner_breaks_end_at_two_joints_within_half_a_slab_of_where_they_meet(tmp_path: Path) -> None:
    name = next(name for number in range(99) if has_slabs(name := f"Slab Road {number}"))
    world = on_street(name, 2.0, "{slab_corner: 1.0}", tmp_path)
    segment, cracks = world.segments[0], of(world, Feature.SLAB_CORNER)
    assert len(cracks) == len(world.defects) > 5
    across, along, line = joints_across(segment), joints_along(segment), segment.centre_line
    sides = set()
    for crack in cracks:
        (dx, dy), (x, y) = direction_at(line, 0.0), point_at(line, 0.0)
        ends = np.array([end.coords[0] for end in _ends(crack)]) - (x, y)
        stations, lefts = ends @ (dx, dy), ends @ (-dy, dx)
        joint, seam = (each[np.abs(each - at.mean()).argmin()] for each, at in ((across, stations), (along, lefts)))
        # One end is at the joint across, half a slab from the corner at most, and the other at the joint along.
        for near, far in ((0, 1), (1, 0)):
            if abs(stations[near] - joint) < 0.15 and abs(lefts[far] - seam) < 0.15:
                assert abs(lefts[near] - seam) < slab_width_m(segment) / 2
                assert abs(stations[far] - joint) < SLAB_M / 2
                sides.add((stations[far] > joint, lefts[near] > seam))
                break
        else:
            raise AssertionError((stations - joint, lefts - seam))
    assert len(sides) > 2, "on several sides of where slabs meet"
    plan = plan_ground(world, 1, holes_of(world.defects), street_style("varied"))
    moved = SlabCracks.of(plan, segment)
    assert set(np.round(moved.stations, 6)) <= set(np.round(across, 6))
    assert set(np.round(moved.lefts, 6)) <= set(np.round(along, 6))
    assert moved.stations
    assert moved.lefts


def test_a_survey_places_cracks_instead_of_networks_on_slabs() -> None:
    slabs = next(name for number in range(99) if has_slabs(name := f"Slab Road {number}"))
    segment = replace(tiny.street("street", (0.0, 0.0), (60.0, 0.0)), street=slabs)
    assert segment.street == slabs
    networks = DefectOptions(per_segment=8, mix={"crocodile_crack": 3.0, "single_crack": 1.0})
    assert {defect.kind for defect in place([segment], 1, networks)} == {"single_crack"}
    plain = replace(segment, street="Plain Road 0")
    assert not has_slabs(plain.street)
    assert "crocodile_crack" in {defect.kind for defect in place([plain], 1, networks)}
    alone = DefectOptions(per_segment=3, mix={"crocodile_crack": 1.0})
    assert {defect.kind for defect in place([segment], 1, alone)} == {"crocodile_crack"}, "nothing else was asked for"


def test_no_slabs_are_drawn_where_a_street_has_networks(tmp_path: Path) -> None:
    name = next(name for number in range(99) if has_slabs(name := f"Slab Road {number}"))
    world = on_street(name, 0.5, "{slab_joint: 1.0}", tmp_path)
    style = street_style("varied")
    found = plan_ground(world, 1, (), style)
    assert found.pavement(found.streets[0]).slabs is not None
    network = replace(world, defects=(replace(world.defects[0], kind="crocodile_crack"),))
    found = plan_ground(network, 1, (), style)
    assert found.pavement(found.streets[0]).slabs is None
    only = style.model_copy(update={"main": {"concrete": 1.0}, "other": {"concrete": 1.0}})
    found = plan_ground(network, 1, (), only)
    assert found.pavement(found.streets[0]).slabs is not None, "the style has nothing else"


def test_no_cracks_run_along_joints_where_a_street_has_none(tmp_path: Path) -> None:
    name = next(name for n in range(99) if not has_slabs(name := f"Plain Road {n}") and not is_paved_apart(name))
    world = on_street(name, 1.0, "{slab_joint: 1.0, lane_joint: 1.0}", tmp_path)
    assert world.defects
    assert not any(each.beside for each in world.defects)


def test_plants_grow_at_kerbs_and_in_joints_of_worn_streets_only(cracked: World) -> None:
    plans = (plan_ground(replace(cracked, defects=()), seed) for seed in range(99))
    plan = next(
        plan for plan in plans if len({plan.ageing(street).age > GROWS_FROM_AGE for street in plan.streets}) > 1
    )
    edges = shapely.boundary(plan.road)
    tufts = {street.key: [] for street in plan.streets}
    for bar, _ in edge_plants(plan):
        near = min(plan.streets, key=lambda street: street.street.centre_line.distance(Point(bar[:2])))
        tufts[near.key].append(bar)
    old = [street for street in plan.streets if plan.ageing(street).age > GROWS_FROM_AGE]
    assert 0 < len(old) < len(plan.streets)
    for street in plan.streets:
        assert bool(tufts[street.key]) == (street in old)
    asphalt = [street for street in old if plan.pavement(street).slabs is None]
    for bar in (bar for street in asphalt for bar in tufts[street.key]):
        assert edges.distance(Point(bar[:2])) < EDGE_WIDTH_M[1]


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
    with pytest.raises(
        PaveTwinError, match=r"context: the shares of cover, patch, trench and of joints sum to more than 1"
    ):
        DefectOptions(population=str(file)).effective()
