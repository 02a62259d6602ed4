"""The weathering and marking maps of a tile's ground."""

from pavetwin.scene.ground.maps.drawn import drawn
from pavetwin.scene.ground.maps.weathering import weathering
from pavetwin.scene.ground.plan import GroundPlan
from pavetwin.scene.model import GroundMaps


def ground_maps(plan: GroundPlan, key: tuple[int, int]) -> GroundMaps:
    """The maps of a tile. Neighbours agree where they overlap, to the size of a texel."""
    weathered, worn = weathering(plan, key)
    return GroundMaps(weathered, drawn(plan, key, worn))
