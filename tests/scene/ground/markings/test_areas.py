"""Hatched areas, boxes and rumble strips: where they belong, as the marking standard states."""

from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.scene.ground import GroundPlan, plan_ground
from pavetwin.scene.ground.markings.areas import corners, islands
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles.marking_standard import (
    BoxJunction,
    Hatching,
    MarkingStandard,
    RumbleStrips,
    marking_standard,
)
from scenes import built

HATCHED = Hatching(stripe_m=(0.4, 0.6), corner_share=1.0, junction_share=1.0)
PLAIN = marking_standard("germany").model_copy(update={"hatching": None, "box": None, "rumble": None})
RUMBLE = {"kind": "painted", "bar_m": (0.2, 0.3), "bars": 5, "groups": 2, "main_share": 1.0, "other_share": 1.0}


@cache
def plan() -> GroundPlan:
    return plan_ground(built("cross").world, 3)


@cache
def without() -> Paint:
    return markings(plan(), PLAIN)


def drawn(**rules: object) -> Paint:
    standard: MarkingStandard = PLAIN.model_copy(update=rules)
    return markings(plan(), standard)


def test_corners_are_the_free_ends_of_parking_lanes() -> None:
    found = list(corners(plan()))
    assert found
    places = shapely.union_all([place.polygon for place in plan().world.parking])
    crossings = shapely.union_all([crossing.polygon for crossing in plan().world.crossings])
    for area, lane, _ in found:
        assert lane.kind == "parking"
        assert lane.centre_line.buffer(lane.width_m / 2).contains(area)
        assert area.distance(places) > 0.3
        assert area.distance(crossings) > 0.9


def test_no_way_crosses_an_island() -> None:
    where = plan()
    ways = shapely.union_all([shapely.LineString(path.line) for path in where.paths])
    found = [area for junction in where.world.junctions for area, _ in islands(where, junction)]
    assert found
    assert min(area.distance(ways) for area in found) > 1.4
    assert all(where.road.buffer(0.1).contains(area) for area in found)


def test_hatching_paints_its_share_of_an_area() -> None:
    bars = drawn(hatching=HATCHED).outlines[len(without().outlines) :]
    areas = [area for area, _, _ in corners(plan())]
    areas += [area for junction in plan().world.junctions for area, _ in islands(plan(), junction)]
    painted = sum(shapely.Polygon(bar).area for bar in bars)
    hatched = [area for area in areas if any(area.buffer(0.01).contains(shapely.Polygon(bar)) for bar in bars)]
    assert len(hatched) > 3
    assert painted == pytest.approx(0.4 * sum(area.area for area in hatched), rel=0.15)


def test_a_box_covers_signalled_junctions_only() -> None:
    bars = drawn(box=BoxJunction(line_m=0.15, every_m=1.5, share=1.0)).outlines[len(without().outlines) :]
    signalled = [each.polygon for each in plan().world.junctions if each.kind == "traffic_light"]
    assert signalled
    assert len(bars) > 10 * len(signalled)
    inside = shapely.union_all(signalled).buffer(0.01)
    assert all(inside.contains(shapely.Polygon(bar)) for bar in bars)


def test_rumble_strips_lie_across_a_lane_before_where_it_waits() -> None:
    bars = drawn(rumble=RumbleStrips.model_validate(RUMBLE)).bars
    found = bars[np.isclose(bars[:, 4], 0.1)]
    lanes = {path.approach.lane.id: path.approach for path in plan().paths}
    waiting = [each for each in lanes.values() if plan().gives_way(each)]
    assert len(found) >= 10 * len(waiting) > 0
    for approach in lanes.values():
        if approach.junction.kind == "traffic_light":
            line = approach.lane.centre_line
            own = shapely.distance(shapely.points(found[:, :2]), line.interpolate(line.length)) < 25.0
            on_lane = shapely.distance(shapely.points(found[:, :2]), line) < 0.2
            assert not (own & on_lane).any()


def test_milled_strips_are_grooves_and_no_paint() -> None:
    milled = drawn(rumble=RumbleStrips.model_validate(RUMBLE | {"kind": "milled"}))
    np.testing.assert_array_equal(milled.bars[~milled.is_former], without().bars[~without().is_former])
    assert len(milled.scars) - len(without().scars) >= 10
