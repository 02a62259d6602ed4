"""The flush things of a tile as instances of their models."""

import numpy as np

from pavetwin.scene.ground.layout import tile_box
from pavetwin.scene.ground.plan import GroundPlan
from pavetwin.scene.model import TILE_M, TINTS, Instance


def fixtures(plan: GroundPlan, key: tuple[int, int]) -> tuple[Instance, ...]:
    """Manhole covers, grates, valve caps and leaves whose middles lie in a tile."""
    found = []
    for index in plan.fixture_index.near(tile_box(key)):
        thing = plan.fixtures[index]
        if (np.floor(thing.x / TILE_M), np.floor(thing.y / TILE_M)) != key:
            continue
        cos, sin = np.cos(thing.yaw_rad), np.sin(thing.yaw_rad)
        transform = np.eye(4)
        transform[:2, :2] = [[cos, -sin], [sin, cos]]
        transform[:3, 3] = thing.x, thing.y, thing.z
        tints = np.ones((TINTS, 4), dtype=np.float32)
        tints[:, 3] = 0.0
        found.append(Instance(thing.model, "body", transform, tints))
    return tuple(found)
