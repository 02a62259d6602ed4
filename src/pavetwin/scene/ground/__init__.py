"""The ground of a world: roads, kerbs, sidewalks and what lies beyond, as meshes, maps and detail textures."""

from pavetwin.scene.ground.details import details
from pavetwin.scene.ground.fixture_models import fixture_models
from pavetwin.scene.ground.furnish import fixtures
from pavetwin.scene.ground.maps import ground_maps
from pavetwin.scene.ground.pieces import ground_pieces
from pavetwin.scene.ground.plan import GroundPlan, plan_ground
from pavetwin.scene.ground.relief import heights

__all__ = [
    "GroundPlan",
    "details",
    "fixture_models",
    "fixtures",
    "ground_maps",
    "ground_pieces",
    "heights",
    "plan_ground",
]
