"""The ground of a world: roads, kerbs, sidewalks and what lies beyond, as meshes, maps and detail textures."""

from pavetwin.scene.ground.ground_plan import GroundPlan, plan_ground
from pavetwin.scene.ground.layout.relief import heights
from pavetwin.scene.ground.maps.ground_maps import ground_maps
from pavetwin.scene.ground.materials.detail_textures import details
from pavetwin.scene.ground.mesh.fixtures import fixture_models, fixtures
from pavetwin.scene.ground.mesh.ground_mesh import ground_pieces

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
