"""Street furniture as instances: trees of the world's sizes, masts with arms, lamps, signs.

Everything stays inside the prisms of `world.solids`, to within centimetres, except the heads of lamps and signals.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from pavetwin.scene.agents import upright
from pavetwin.scene.looks import tints
from pavetwin.scene.model import Instance, Model
from pavetwin.scene.models import BODY, bounds
from pavetwin.scene.shafts import SHAFT
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Furniture, FurnitureKind

KEY: Final = 5
"""Key of this module's child of the scene's random stream."""

GALVANISED: Final = (0.36, 0.37, 0.38)
PAINTED: Final = ((0.36, 0.37, 0.38), (0.06, 0.07, 0.065), (0.17, 0.18, 0.19), (0.03, 0.055, 0.04))
"""Colours of lamp posts in different streets."""

TIMBER: Final = (0.15, 0.11, 0.075)
ARM_RADIUS_M: Final = {FurnitureKind.STREET_LIGHT: 0.035, FurnitureKind.SIGNAL: 0.07}
LAMP_M: Final = 0.62
"""Length of a lamp's head."""

SIGN_FACE_M: Final = 0.35
"""From the top of a sign's post down to the middle of its plate."""

SIGNS: Final = ("sign_triangle", "sign_octagon", "sign_round")
SIGN_SHARES: Final = (0.5, 0.2, 0.3)
"""Signs at unsignalled approaches: give way, stop, or speed limit. Ours."""


def stand(item: Furniture, number: int, ground_m: float, seed: int, models: Mapping[str, Model]) -> Iterator[Instance]:
    """The instances of one item of street furniture.

    Args:
        number: its index in the world's list, the key of its random stream.
        ground_m: height of the ground where it stands.
    """
    rng = child(seed, Stream.SCENE, KEY, number)
    match item.kind:
        case FurnitureKind.TREE:
            yield from _tree(item, ground_m, rng, models)
        case FurnitureKind.STREET_LIGHT:
            yield from _light(item, ground_m)
        case FurnitureKind.SIGNAL:
            yield from _mast(item, ground_m, "tapered", GALVANISED)
        case FurnitureKind.SIGN:
            yield from _mast(item, ground_m, "straight", GALVANISED)
            yield from _plate(item, rng)
        case FurnitureKind.POLE:
            yield from _mast(item, ground_m, "tapered", TIMBER)


def pole(x_m: float, y_m: float, low_m: float, high_m: float, radius_m: float) -> Instance:
    """A plain post."""
    place = upright(x_m, y_m, 0.0, z_m=low_m, scale=(radius_m, radius_m, high_m - low_m))
    return Instance(SHAFT, "straight", place, tints(GALVANISED))


def _tree(
    item: Furniture, ground_m: float, rng: np.random.Generator, models: Mapping[str, Model]
) -> Iterator[Instance]:
    model = _nearest_tree(item, rng, models)
    low, high = bounds(model.parts["crown"])
    across = item.radius_m / model.extras["crown_radius_m"]
    clear = max(item.clear_height_m, ground_m + 0.2)
    upwards = (item.height_m - clear) / float(high[2] - low[2])
    yaw = float(rng.uniform(0, 2 * math.pi))
    x, y = item.position.x, item.position.y
    fresh, yellow = np.exp((0.16, 0.10) * np.clip(rng.standard_normal(2), -2, 2))
    leaf = (float(fresh * yellow), float(fresh), float(fresh * 0.9))
    crown = upright(x, y, yaw, z_m=clear - upwards * float(low[2]), scale=(across, across, upwards))
    yield Instance(model.name, "crown", crown, tints(leaf))
    trunk_top = clear + upwards * (float(bounds(model.parts["trunk"])[1][2]) - float(low[2]))
    height = (trunk_top - ground_m) / float(bounds(model.parts["trunk"])[1][2])
    yield Instance(model.name, "trunk", upright(x, y, yaw, z_m=ground_m, scale=(across, across, height)), tints())


def _nearest_tree(item: Furniture, rng: np.random.Generator, models: Mapping[str, Model]) -> Model:
    """A model that needs the least scaling: one of the nearest two."""
    trees = [models[name] for name in sorted(models) if name.startswith("tree_")]

    def stretch(model: Model) -> float:
        across = math.log(item.radius_m / model.extras["crown_radius_m"])
        upwards = math.log(item.height_m / model.extras["height_m"])
        return abs(across) + abs(upwards) + abs(across - upwards)

    ranked = sorted(trees, key=stretch)
    return ranked[int(rng.random() < 0.35) if len(ranked) > 1 else 0]


def _light(item: Furniture, ground_m: float) -> Iterator[Instance]:
    street = int(item.position.x // 150) * 31 + int(item.position.y // 150)
    colour = PAINTED[street % len(PAINTED)]
    yield from _mast(item, ground_m, "tapered", colour)
    reach = max(0.0, item.arm_m - LAMP_M)
    x = item.position.x + reach * math.cos(item.yaw_rad)
    y = item.position.y + reach * math.sin(item.yaw_rad)
    yield Instance("lamp_head", BODY, upright(x, y, item.yaw_rad, z_m=item.height_m), tints(colour))


def _mast(item: Furniture, ground_m: float, part: str, colour: tuple[float, float, float]) -> Iterator[Instance]:
    """The mast and, where it has one, its arm."""
    x, y = item.position.x, item.position.y
    size = (item.radius_m, item.radius_m, item.height_m - ground_m)
    yield Instance(SHAFT, part, upright(x, y, 0.0, z_m=ground_m, scale=size), tints(colour))
    if item.arm_m > 0:
        radius = ARM_RADIUS_M[item.kind]
        length = item.arm_m - (LAMP_M if item.kind is FurnitureKind.STREET_LIGHT else 0.0)
        place = upright(x, y, item.yaw_rad, z_m=item.height_m - radius, scale=(max(length, 0.05), radius, radius))
        yield Instance(SHAFT, "level", place, tints(colour))


def _plate(item: Furniture, rng: np.random.Generator) -> Iterator[Instance]:
    """The plate faces oncoming traffic: its edge is along the furniture's yaw, as in its solid."""
    name = SIGNS[int(rng.choice(len(SIGNS), p=SIGN_SHARES))]
    facing = item.yaw_rad + math.pi / 2
    x = item.position.x + (item.radius_m + 0.012) * math.cos(facing)
    y = item.position.y + (item.radius_m + 0.012) * math.sin(facing)
    yield Instance(name, BODY, upright(x, y, facing, z_m=item.height_m - SIGN_FACE_M), tints())
