"""Lines, arrows, crossings and parking places: whole corners, the network's connections, kerb to kerb."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, affinity
from shapely.geometry.base import BaseGeometry

from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.ground_plan import GroundPlan
from pavetwin.scene.ground.markings.painter import Painter
from pavetwin.scene.ground.markings.placement import CROSSING_KERB_M, arrow, parking_lines
from pavetwin.world.model import Direction, LaneKind
from scenes import built
from scenes.roads import parting_lanes

WIDTH_M, UNEVEN_M = 0.12, 0.006
SLIVER_M2 = 5e-5


def painted(path: BaseGeometry) -> BaseGeometry:
    """What the bars of a line along a path cover."""
    painter = Painter()
    painter.line(path, WIDTH_M, 0.0)
    paint = painter.done()
    half = paint.bars[:, 4].tolist()
    bars = [LineString(ends).buffer(wide, cap_style="flat") for ends, wide in zip(paint.ends(), half, strict=True)]
    return shapely.union_all(bars)


@pytest.mark.parametrize(
    "ring",
    [
        [(0, 0), (2, 0), (2, 1), (0, 1)],
        [(0, 0), (9, 0), (9, 2), (0, 2)],  # longer than one bar may be
        [(0, 0), (2, 0), (3, 1.5), (1, 2.5), (-0.5, 1.2)],
    ],
)
def test_a_border_has_whole_corners_and_no_stubs(ring: list[tuple[float, float]]) -> None:
    area = Polygon(ring)
    found = painted(area.exterior)

    def border(half_m: float) -> BaseGeometry:
        outer, inner = (area.buffer(away, join_style="mitre") for away in (half_m, -half_m))
        return shapely.difference(outer, inner)

    assert shapely.difference(found, border(WIDTH_M / 2 + UNEVEN_M)).area < SLIVER_M2
    assert shapely.difference(border(WIDTH_M / 2 - UNEVEN_M), found).area < SLIVER_M2


def test_a_bent_line_has_no_gaps_where_its_bars_meet() -> None:
    turns = np.linspace(0.0, np.pi / 2, 12)
    path = LineString(np.column_stack([10 * np.sin(turns), 10 * np.cos(turns)]))
    found = painted(path)
    seen = path.buffer(WIDTH_M / 2 - 0.001, cap_style="flat")
    assert shapely.difference(seen, found).area < 5e-4, "without laps 25e-4"
    assert shapely.difference(found, path.buffer(WIDTH_M / 2 + UNEVEN_M)).area < 5e-4


@pytest.mark.parametrize(("left_hand", "turn"), [(False, Direction.LEFT), (True, Direction.RIGHT)])
def test_a_lane_that_only_turns_gets_the_arrow_of_its_connection(
    tmp_path: Path, left_hand: bool, turn: Direction
) -> None:
    """The lane in the middle could go straight on as well by its place, yet its only connection turns."""
    world = parting_lanes(tmp_path, left_hand=left_hand).world
    outlines = plan_ground(world, 3).paint.outlines
    kerb, middle = world.lanes_on("in")
    for lane, direction in ((kerb, Direction.STRAIGHT), (middle, turn)):
        (shape,) = arrow(frozenset({direction}))
        y = lane.centre_line.coords[0][1]
        on_lane = [ring for ring in outlines if abs(ring[:, 1].mean() - y) < lane.width_m / 2]
        assert len(on_lane) == 2
        for ring in on_lane:
            assert ring - (ring[:, 0].min(), y) == pytest.approx(shape - (shape[:, 0].min(), 0.0))


def test_lines_between_lanes_are_painted_between_them_in_left_hand_traffic(tmp_path: Path) -> None:
    world = parting_lanes(tmp_path, left_hand=True).world
    kerb, middle = (lane.centre_line.coords[0][1] for lane in world.lanes_on("in"))
    bars = plan_ground(world, 3).paint.bars
    along = bars[np.isclose(np.cos(bars[:, 2]) ** 2, 1.0) & (bars[:, 0] < 95.0)]
    assert np.isclose(along[:, 1], (kerb + middle) / 2).any()
    assert (np.abs(along[:, 1] - (kerb + middle) / 2) < 3.2).all(), "no line beyond a kerb"


def test_ways_across_lead_from_lane_to_lane_within_their_junctions() -> None:
    world = built("cross").world
    plan = plan_ground(world, 3)
    assert len(plan.paths) > 20
    starts = {lane.id: lane.centre_line.coords[-1] for lane in world.lanes}
    for path in plan.paths:
        assert tuple(path.line[0]) == starts[path.approach.lane.id]
        inside = path.approach.junction.polygon.buffer(1.0)
        line = shapely.LineString(path.line)
        assert shapely.intersection(line, inside).length > 0.9 * line.length


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


def test_places_are_divided_by_lines_on_their_parking_lane_off_the_gutter() -> None:
    world = built("cross").world
    strips = [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in world.lanes_of(LaneKind.PARKING)]
    lanes = shapely.union_all(strips).buffer(0.1)
    drawn = list(parking_lines(world))
    rows = len(world.parking)
    assert rows < len(drawn) < 1.5 * rows, "one between neighbours, and one at both ends of a row"
    assert {place.street for _, place in drawn} == {place.street for place in world.parking}
    for line, _ in drawn:
        assert lanes.contains(line)
        assert 1.3 < line.length < 1.6, "of 2 m"
        assert line.distance(world.carriageway.boundary) > 0.35
