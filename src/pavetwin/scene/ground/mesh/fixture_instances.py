"""The flush fixtures of a tile as instances of their models."""

import numpy as np

from pavetwin.scene.agents import upright
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.plan import GroundPlan
from pavetwin.scene.looks import tints
from pavetwin.scene.model import TILE_M, Instance
from pavetwin.scene.models import BODY


def fixtures(plan: GroundPlan, key: tuple[int, int]) -> tuple[Instance, ...]:
    """Manhole covers, grates, valve caps and leaves whose middles lie in a tile."""
    near = [plan.fixtures[index] for index in plan.fixture_index.near(tile_box(key))]
    return tuple(
        Instance(each.model, BODY, upright(each.x, each.y, each.yaw_rad, z_m=each.z), tints())
        for each in near
        if (np.floor(each.x / TILE_M), np.floor(each.y / TILE_M)) == key
    )
