"""One carriageway: segments and the driven part of junctions, and the same for whoever asks."""

import pytest
import shapely

from pavetwin.capture.image_spec import DefectIndex
from pavetwin.scene.ground import plan_ground
from scenes import built


@pytest.mark.parametrize("name", ["cross", "town", "berlin_neukoelln"])
def test_it_holds_every_segment_and_beyond_them_only_what_is_on_junctions(name: str) -> None:
    world = built(name).world
    segments = shapely.union_all([segment.polygon for segment in world.segments])
    assert segments.difference(world.carriageway.buffer(0.02)).area < 1e-6
    junctions = shapely.union_all([junction.polygon.buffer(8.0) for junction in world.junctions])
    beyond = world.carriageway.difference(segments.buffer(0.02))
    assert beyond.area > 10.0
    assert beyond.difference(junctions).area < 0.01 * beyond.area


def test_the_paved_corners_of_junctions_are_not_part_of_it() -> None:
    world = built("cross").world
    junctions = shapely.union_all([junction.polygon for junction in world.junctions])
    walks = [crossing.polygon for crossing in world.crossings]
    assert junctions.difference(world.carriageway).area > 20.0
    assert shapely.union_all(walks).difference(world.carriageway).area < 0.2 * shapely.union_all(walks).area


def test_scenes_and_datasets_take_it_as_it_is() -> None:
    world = built("cross").world
    assert plan_ground(world, 0).road is world.carriageway
    assert DefectIndex(world, {}).road is world.carriageway
