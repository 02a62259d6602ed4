"""Patches of defects: their holes never meet, they fill them, and they meet the road level."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.defects import DefectOptions, heightfield_of, place
from pavetwin.scene.patches import BAY_M, BESIDE_M, COARSE_M, TOLERANCE_M, holes_of, part_on, patch_of
from pavetwin.scene.values import DefectPatch, labelled_defect
from pavetwin.world.model import Defect
from scenes import tiny


@cache
def crowded() -> tuple[Defect, ...]:
    """As many defects as find room on 40 m of street."""
    street = tiny.street("street", (0.0, 0.0), (40.0, 0.0))
    return place([street], 3, DefectOptions(population="paper", per_segment=60))


@cache
def patch(index: int) -> DefectPatch:
    return patch_of(crowded()[index])


def some() -> list[int]:
    """A few of every class."""
    kinds: dict[str, list[int]] = {}
    for index, defect in enumerate(crowded()):
        kinds.setdefault(defect.kind, []).append(index)
    return [index for indices in kinds.values() for index in indices[:3]]


def world_corners(patch: DefectPatch) -> np.ndarray:
    """(m, 3, 3) of its triangles, world frame."""
    points = patch.mesh.positions.astype(float) @ patch.transform[:3, :3].T + patch.transform[:3, 3]
    return points[patch.mesh.indices]


def plan_area(corners: np.ndarray) -> float:
    """Of triangles seen from above; those that face down count against it."""
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0])[:, :2].T, (corners[:, 2] - corners[:, 0])[:, :2].T
    return float((ax * by - ay * bx).sum() / 2)


def test_the_scene_is_crowded_enough_for_rectangles_to_overlap() -> None:
    boxes = [shapely.box(*hole.bounds) for hole in holes_of(crowded())]
    pairs = shapely.STRtree(boxes).query(boxes, predicate="intersects")
    assert (pairs[0] < pairs[1]).sum() > 3


def test_holes_hold_their_defects_and_never_meet() -> None:
    holes = holes_of(crowded())
    for defect, hole in zip(crowded(), holes, strict=True):
        assert hole.is_valid
        assert hole.contains(defect.polygon)
        assert shapely.distance(shapely.points(hole.exterior.coords), defect.polygon).max() < BESIDE_M + BAY_M
    total = shapely.union_all(holes).area
    assert total == pytest.approx(sum(hole.area for hole in holes), rel=1e-9)


def test_holes_stay_on_the_carriageway() -> None:
    road = tiny.street("street", (0.0, 0.0), (40.0, 0.0)).polygon
    assert all(road.contains(hole) for hole in holes_of(crowded()))


@pytest.mark.parametrize("coarse", [False, True])
@pytest.mark.parametrize("index", some())
def test_a_patch_fills_its_hole_exactly(index: int, coarse: bool) -> None:
    made = patch(index)
    corners = world_corners(replace(made, mesh=made.coarse) if coarse else made)
    (hole,) = holes_of((crowded()[index],))
    assert plan_area(corners) == pytest.approx(hole.area, rel=1e-4)
    triangles = shapely.polygons(corners[:, :, :2])
    inside = shapely.contains(hole.buffer(1e-4), triangles)
    assert inside.all()


@pytest.mark.parametrize("index", some())
def test_a_patch_meets_the_road_at_its_height_and_with_its_looks(index: int) -> None:
    made = patch(index)
    points = made.mesh.positions.astype(float) @ made.transform[:3, :3].T + made.transform[:3, 3]
    on_ring = shapely.distance(holes_of((crowded()[index],))[0].exterior, shapely.points(points[:, :2])) < 1e-4
    assert on_ring.sum() > 10
    assert np.abs(points[on_ring, 2]).max() == 0
    assert made.mesh.uv is not None
    rows, cols = made.relief.shape[:2]
    texel = np.clip((made.mesh.uv[on_ring] * (cols, rows)).astype(int), 0, (cols - 1, rows - 1))
    seen = made.relief[texel[:, 1], texel[:, 0]].astype(int)
    assert np.abs(seen - (128, 128, 128, 255)).max() <= 2
    assert (made.mask[texel[:, 1], texel[:, 0]] == 0).all()


@pytest.mark.parametrize("index", some())
def test_a_patch_is_as_deep_as_its_defect_and_labelled_where_it_is(index: int) -> None:
    made, defect = patch(index), crowded()[index]
    field = heightfield_of(defect)
    assert labelled_defect(made.label) == defect.id
    x0, y0, x1, y1 = field.bounds_m
    texel_m2 = (x1 - x0) * (y1 - y0) / made.mask.size
    assert (made.mask > 0).sum() * texel_m2 == pytest.approx(defect.polygon.area, rel=0.02)
    if defect.kind == "pothole":
        assert -made.mesh.positions[:, 2].min() == pytest.approx(-field.height_m.min(), abs=0.006)
    # The relief's slopes are the heightfield's: seen where it falls most along x.
    slope = np.gradient(field.height_m, field.cell_m, axis=1)
    steep = np.abs(slope) > 0.5 * np.abs(slope).max()
    assert (np.sign(made.relief[..., 0][steep].astype(int) - 128) == -np.sign(slope[steep])).mean() > 0.98


def test_a_coarse_mesh_has_fewer_triangles_and_the_same_depth_but_for_its_tolerance() -> None:
    finer = coarser = 0
    for index in some():
        made = patch(index)
        finer, coarser = finer + len(made.mesh.indices), coarser + len(made.coarse.indices)
        off = made.mesh.positions[:, 2].min() - made.coarse.positions[:, 2].min()
        assert abs(off) <= TOLERANCE_M + COARSE_M
    assert coarser < 0.5 * finer


def test_the_parts_on_tiles_are_the_whole() -> None:
    keys = [(column, row) for column in (0, 1) for row in (-1, 0)]
    shared = 0
    for index in range(len(crowded())):
        low_x, low_y, high_x, high_y = holes_of((crowded()[index],))[0].bounds
        if not (low_x < 32 < high_x or low_y < 0 < high_y):
            continue
        parts = [part for key in keys if (part := part_on(patch(index), key)) is not None]
        assert sum(len(part.mesh.indices) for part in parts) == len(patch(index).mesh.indices)
        areas = sum(plan_area(world_corners(part)) for part in parts)
        assert areas == pytest.approx(plan_area(world_corners(patch(index))), rel=1e-6)
        assert {part.label for part in parts} == {patch(index).label}
        shared += len(parts) > 1
    assert shared > 0


def test_every_part_knows_where_its_maps_lie() -> None:
    """Also the smallest: uv is one straight line over the positions, whatever triangles a part has."""
    sizes = []
    for index in range(len(crowded())):
        x0, y0, x1, y1 = heightfield_of(crowded()[index]).bounds_m
        for key in ((0, 0), (0, -1), (1, 0), (1, -1)):
            part = part_on(patch(index), key)
            if part is not None:
                assert part.mesh.uv is not None
                expected = (part.mesh.positions[:, :2] - (x0, y0)) / (x1 - x0, y1 - y0)
                assert np.abs(part.mesh.uv - expected).max() < 1e-5
                sizes.append(len(part.mesh.indices))
    assert min(sizes) < 30


def test_a_part_reaches_over_its_tile_by_less_than_the_maps() -> None:
    for index in range(len(crowded())):
        for key in ((0, 0), (0, -1), (1, 0), (1, -1)):
            part = part_on(patch(index), key)
            if part is not None:
                corners = world_corners(part)[..., :2].reshape(-1, 2) - np.array(key) * 32.0
                assert corners.min() > -0.5
                assert corners.max() < 32.5
