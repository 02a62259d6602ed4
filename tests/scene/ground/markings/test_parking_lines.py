"""Lines between parking places on the carriageway."""

import shapely

from pavetwin.scene.ground.markings.placement import parking_lines
from pavetwin.world.model import LaneKind
from scenes import built


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
