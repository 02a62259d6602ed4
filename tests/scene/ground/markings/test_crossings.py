"""Painted crossings: from kerb to kerb, and never one over another, however the map cut a junction in pieces."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import affinity

from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.ground_plan import GroundPlan
from pavetwin.scene.ground.markings.placement import CROSSING_KERB_M
from scenes import built


def stripes(plan: GroundPlan) -> np.ndarray:
    """Middles (n, 2) of all stripes of crossings."""
    bars = plan.paint.bars
    return np.asarray(bars[np.isclose(bars[:, 4] * 2, plan.standard.stripe_m[0])][:, :2])


@pytest.mark.parametrize("town", ["berlin_neukoelln", "seattle_roosevelt"])
def test_no_stripe_lies_on_two_crossings(town: str) -> None:
    plan = plan_ground(built(town).world, 3)
    tree = shapely.STRtree([crossing.polygon.buffer(-0.3) for crossing in plan.world.crossings])
    where, _ = tree.query(shapely.points(stripes(plan)), "intersects")
    assert len(where) > 50
    assert len(where) == len(np.unique(where))


@pytest.mark.parametrize("town", ["berlin_neukoelln", "seattle_roosevelt"])
def test_stripes_belong_to_crossings_that_reach_the_kerb(town: str) -> None:
    plan = plan_ground(built(town).world, 3)
    kerb = plan.road.boundary
    shapes = [crossing.polygon for crossing in plan.world.crossings]
    where, which = shapely.STRtree(shapes).query(shapely.points(stripes(plan)), "intersects")
    assert len(where)
    for index in np.unique(which):
        ring = shapely.get_coordinates(shapes[index])
        ends = [shapely.Point(ring[[k, k + 1]].mean(axis=0)) for k in (0, 2)]
        assert max(end.distance(kerb) for end in ends) < CROSSING_KERB_M


def test_a_crossing_is_painted_until_another_crosses_it() -> None:
    world = built("berlin_neukoelln").world
    painted = stripes(plan_ground(world, 3))
    counts = [int(shapely.contains_xy(crossing.polygon, painted).sum()) for crossing in world.crossings]
    first = world.crossings[int(np.argmax(counts))]
    turned = replace(first, id="turned", polygon=affinity.rotate(first.polygon, 90.0))
    crossed = stripes(plan_ground(replace(world, crossings=(*world.crossings, turned)), 3))
    assert len(crossed) <= len(painted) - max(counts) < len(painted)
