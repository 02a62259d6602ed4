"""Joints at the ends of bridges and between slabs: across the whole carriageway, and never over a defect."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pavetwin.scene.ground import GroundPlan, plan_ground
from pavetwin.scene.ground.distractors.fixtures import MODULE_M
from pavetwin.scene.ground.distractors.segment_marks import SEAM_HALF_M
from pavetwin.scene.ground.styles import pavement, street_style
from pavetwin.scene.patches import holes_of
from scenes import tiny

ENDS = (15.0, 42.0)


@cache
def plan(kind: str, *places: tuple[float, float], bridge: bool = True) -> GroundPlan:
    """The usual street, on a bridge from 15 to 42 m."""
    plain = tiny.straight(*places)
    street = replace(plain.streets[0], bridges=(ENDS,) if bridge else ())
    style = street_style("uniform").model_copy(update={"bridge_joints": {kind: 1.0}})
    return plan_ground(replace(plain, streets=(street,)), 3, holes_of(plain.defects), style)


def modules(of: GroundPlan) -> np.ndarray:
    """(n, 3): x, y and yaw of the modules of steel joints."""
    steel = [each for each in of.fixtures if each.model.startswith("joint_")]
    return np.array([(each.x, each.y, each.yaw_rad) for each in steel]).reshape(-1, 3)


@pytest.mark.parametrize("kind", ["joint_comb", "joint_strip"])
def test_steel_joints_lie_across_the_carriageway_at_both_ends(kind: str) -> None:
    assert not len(modules(plan(kind, bridge=False)))
    found = modules(plan(kind))
    assert set(np.round(found[:, 0], 3)) == set(ENDS)
    for end in ENDS:
        left = np.sort(found[np.isclose(found[:, 0], end), 1])
        np.testing.assert_allclose(np.diff(left), MODULE_M)
        assert left[0] - MODULE_M / 2 == pytest.approx(-3.5, abs=MODULE_M / 2)
        assert left[-1] + MODULE_M / 2 == pytest.approx(3.5, abs=MODULE_M / 2)
    assert np.abs(np.sin(found[:, 2])).max() < 1e-6


def test_a_joint_leaves_out_what_would_cover_a_defect() -> None:
    free, broken = modules(plan("joint_strip")), modules(plan("joint_strip", (15.0, 1.0)))
    assert 0 < len(free) - len(broken) < 5
    near = np.hypot(broken[:, 0] - 15.0, broken[:, 1] - 1.0)
    assert near.min() > 0.3


def test_plugs_are_dark_strips_with_sealed_edges() -> None:
    found, plain = plan("plug"), plan("plug", bridge=False)
    new = found.patches[len(plain.patches) :]
    assert sorted(new[:, 0]) == pytest.approx(ENDS)
    assert (new[:, 5] < 0.7).all()
    assert len(found.repairs.seals) == len(plain.repairs.seals) + 4
    assert found.repairs.seal_halves_m[-1] == SEAM_HALF_M[1]


def test_some_joints_between_slabs_are_wide_ones() -> None:
    slabs = pavement("concrete").slabs
    assert slabs is not None
    concrete = street_style("uniform").model_copy(update={"main": {"concrete": 1.0}, "other": {"concrete": 1.0}})
    repairs = plan_ground(tiny.straight(length_m=200.0), 3, style=concrete).repairs
    across = [
        half for line, half in zip(repairs.seals, repairs.seal_halves_m, strict=True) if abs(np.ptp(line[:, 1])) > 7
    ]
    wide = np.isclose(across, slabs.expansion_half_width_m)
    assert slabs.expansion_every is not None
    assert wide.sum() == pytest.approx(len(across) / slabs.expansion_every, abs=1.5)
    assert wide.any()
