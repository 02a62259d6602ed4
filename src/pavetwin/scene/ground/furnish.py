"""The flush fixtures of a tile as instances of their models."""

import numpy as np

from pavetwin.scene.ground.layout import tile_box
from pavetwin.scene.ground.plan import GroundPlan
from pavetwin.scene.model import TILE_M, TINTS, Instance


def fixtures(plan: GroundPlan, key: tuple[int, int]) -> tuple[Instance, ...]:
    """Manhole covers, grates, valve caps and leaves whose middles lie in a tile."""
    found = []
    for index in plan.fixture_index.near(tile_box(key)):
        fixture = plan.fixtures[index]
        if (np.floor(fixture.x / TILE_M), np.floor(fixture.y / TILE_M)) != key:
            continue
        cos, sin = np.cos(fixture.yaw_rad), np.sin(fixture.yaw_rad)
        transform = np.eye(4)
        transform[:2, :2] = [[cos, -sin], [sin, cos]]
        transform[:3, 3] = fixture.x, fixture.y, fixture.z
        tints = np.ones((TINTS, 4), dtype=np.float32)
        tints[:, 3] = 0.0
        found.append(Instance(fixture.model, "body", transform, tints))
    return tuple(found)
