"""Repairs of other materials than their street's: cut into the mesh, clear of defects, of one age each."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

from pavetwin.scene.ground import GroundPlan, ground_pieces, plan_ground
from pavetwin.scene.ground.styles import pavement, street_style
from pavetwin.scene.ground.styles.street_style import RepairMaterials
from pavetwin.scene.patches import holes_of
from pavetwin.scene.values import GroundKind
from pavetwin.world.pavement_joints import joints_along
from scenes import tiny

CONCRETE = {"repair_concrete": 1.0}
EVERY = "patches trenches cold_patches"


@cache
def plan(*places: tuple[float, float], seed: int = 3, of_concrete: str = "", cold: float = 0.0) -> GroundPlan:
    """The usual street of grey asphalt; some repairs are of concrete, `cold` of them thrown on 100 m."""
    world = tiny.straight(*places)
    tables = dict.fromkeys(of_concrete.split(), CONCRETE)
    repairs = RepairMaterials.model_validate(tables | {"cold_patches_per_100_m": cold})
    style = street_style("uniform").model_copy(update={"repairs": repairs})
    return plan_ground(world, seed, holes_of(world.defects), style)


def cuts(of: GroundPlan) -> list[shapely.Polygon]:
    return [shape for each in of.repairs.cuts.values() for shape, _ in each]


def test_a_repair_of_another_material_is_cut_into_the_mesh() -> None:
    assert not cuts(plan())
    of = plan(of_concrete=EVERY, cold=30.0)
    area_m2 = shapely.union_all(cuts(of)).area
    pieces = [piece for key in ((0, -1), (0, 0), (1, -1), (1, 0)) for piece in ground_pieces(of, key)]
    assert GroundKind.SLABS in {piece.kind for piece in pieces}
    meshed = 0.0
    for piece in pieces:
        if piece.kind is GroundKind.SLABS:
            (ax, ay, _), (bx, by, _), (cx, cy, _) = piece.mesh.positions[piece.mesh.indices].transpose(1, 2, 0)
            meshed += float(((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)).sum() / 2)
    assert meshed == pytest.approx(area_m2, rel=0.01)
    inside = max(cuts(of), key=lambda shape: shape.area).representative_point()
    assert of.paved_at(inside.x, inside.y).kind is GroundKind.SLABS


def test_repairs_of_another_material_keep_clear_of_defects() -> None:
    free = plan(seed=4, of_concrete=EVERY, cold=40.0)
    middles = [shape.representative_point() for shape in cuts(free)[::2]]
    broken = plan(*((point.x, point.y) for point in middles), seed=4, of_concrete=EVERY, cold=40.0)
    holes = shapely.union_all(holes_of(broken.world.defects))
    assert shapely.union_all(cuts(free)).intersects(holes)
    assert cuts(broken)
    assert shapely.union_all(cuts(broken)).distance(holes) > 0.04


def test_a_trench_along_a_street_is_of_one_material_and_age() -> None:
    found = [plan(seed=seed, of_concrete="trenches") for seed in range(12)]
    trenches = [surface for of in found for each in of.repairs.cuts.values() for _, surface in each]
    assert len(trenches) > len(set(trenches)) > 1


def test_cold_patches_are_as_many_as_their_rate_states() -> None:
    few, many = (
        sum(len(cuts(plan(seed=seed, of_concrete="cold_patches", cold=rate))) for seed in range(8))
        for rate in (12.0, 48.0)
    )
    assert 2 * few < many < 12 * few


def test_sealed_cracks_are_as_many_as_the_rate_of_the_pavement_states(tmp_path: Path) -> None:
    """On 100 m of a street of age 1 on average 5 across it and 1.4 along it; none on new ones."""
    world, seeds, length_m = tiny.straight(length_m=200.0), 30, 200.0
    counts = {}
    for age in (0.0, 1.0):
        values = pavement("dense_asphalt").model_dump(mode="json") | {
            "age": {"least": age, "most": age},
            "repairs": {"patches": 0.0, "trenches": 0.0, "sealed_cracks": 2.0, "joint_share": 0.0},
        }
        path = tmp_path / f"{age}.yaml"
        path.write_text(yaml.safe_dump(values), encoding="utf-8")
        uniform = street_style("uniform")
        none = uniform.stretches.model_copy(update={"share": 0.0})
        style = uniform.model_copy(update={"other": {str(path): 1.0}, "stretches": none})
        found = [line for seed in range(seeds) for line in plan_ground(world, seed, style=style).repairs.seals]
        open_ = [line for line in found if not np.allclose(line[0], line[-1])]  # not around manhole covers
        extents = np.array([np.ptp(line, axis=0) for line in open_]).reshape(-1, 2)
        short = extents[extents[:, 0] < 17.0]
        across = short[:, 1] > short[:, 0]
        counts[age] = across.sum(), (~across).sum()
    assert counts[0.0] == (0, 0)
    per_100_m = np.array(counts[1.0]) / seeds / (length_m / 100) / 2.0
    assert per_100_m[0] == pytest.approx(100 / 20, rel=0.25)
    assert per_100_m[1] == pytest.approx(100 / 70, rel=0.35)


def test_sealed_cracks_along_slabs_keep_off_the_joints(tmp_path: Path) -> None:
    repairs = {"patches": 0.0, "trenches": 0.0, "sealed_cracks": 4.0, "joint_share": 0.0}
    values = pavement("concrete").model_dump(mode="json") | {"repairs": repairs}
    (tmp_path / "cracked.yaml").write_text(yaml.safe_dump(values), encoding="utf-8")
    only = {"cracked.yaml": 1}
    path = tmp_path / "style.yaml"
    style = {"title": "one", "main": only, "other": only, "stretches": {"share": 0, "pavements": only}}
    path.write_text(yaml.safe_dump(style), encoding="utf-8")
    world, slabs, count = tiny.straight(length_m=200.0), pavement("concrete").slabs, 0
    assert slabs is not None
    joints = joints_along(world.segments[0])
    assert len(joints)
    for seed in range(12):
        found = plan_ground(world, seed, style=street_style(str(path))).repairs
        for line, half_m in zip(found.seals, found.seal_halves_m, strict=True):
            extent = np.ptp(line, axis=0)
            if half_m in (slabs.half_width_m, slabs.expansion_half_width_m) or extent[0] < 3 * extent[1]:
                continue
            count += 1
            assert np.abs(line[:, 1, None] - joints).min() > 0.3
    assert count > 5
