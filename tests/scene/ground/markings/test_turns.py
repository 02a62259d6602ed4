"""Painted arrows and wheel tracks follow the connections of the network."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.markings.placement import arrow
from pavetwin.world.model import Direction
from scenes import built
from scenes.roads import parting_lanes


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
