"""Procedural cylinders for masts, arms and posts: unit shapes that instances scale."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float32Array
from pavetwin.scene.values import Mesh, Model

SIDES: Final = 12
TAPER: Final = 0.62
"""Radius of a tapered mast at the top over that at the foot."""

SHAFT: Final = "shaft"
"""Parts `straight` and `tapered`: upright, radius 1 and height 1, open below. Part `level`: from the origin along x."""

WIRE: Final = "wire"
"""A model whose only part is a rod from the origin along x, radius 1 and length 1, open at both ends."""

THIN: Final = "thin"
"""Among a model's extras: it is too thin for shadow maps; its shadow comes from `scene.thin`."""

ROD_SIDES: Final = 5


@cache
def shafts() -> Mapping[str, Model]:
    """The procedural models, by name. Their colour is slot 1, white."""
    upright = {"straight": _tube(1.0), "tapered": _tube(TAPER)}
    wire = Model(WIRE, MappingProxyType({"body": rod()}), {THIN: 1.0})
    return MappingProxyType(
        {SHAFT: Model(SHAFT, MappingProxyType({**upright, "level": _lying(_tube(1.0))})), WIRE: wire}
    )


@cache
def rod() -> Mesh:
    """A rod along x with few sides; white, slot 1."""
    angles = 2 * np.pi * np.arange(ROD_SIDES) / ROD_SIDES
    ring = np.column_stack([np.zeros(ROD_SIDES), np.cos(angles), np.sin(angles)])
    return Mesh(
        positions=np.concatenate([ring, ring + [1.0, 0.0, 0.0]]).astype(np.float32),
        normals=np.concatenate([ring, ring]).astype(np.float32),
        indices=_walls(ROD_SIDES).astype(np.uint32),
        colours=np.ones((2 * ROD_SIDES, 3), dtype=np.float32),
        surface=np.tile(np.array([150, 0, 1], dtype=np.uint8), (2 * ROD_SIDES, 1)),
    )


def _walls(sides: int) -> npt.NDArray[np.integer]:
    """(2 sides, 3) triangles between a ring of vertices and the next one."""
    here, following = np.arange(sides), (np.arange(sides) + 1) % sides
    lower = np.stack([here, following, sides + following], axis=1)
    return np.concatenate([lower, np.stack([here, sides + following, sides + here], axis=1)])


def _tube(top: float) -> Mesh:
    """A tube of radius 1 at z = 0 and `top` at z = 1, with a lid."""
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    foot = np.column_stack([ring, np.zeros(SIDES)])
    head = np.column_stack([ring * top, np.ones(SIDES)])
    side = np.column_stack([ring, np.full(SIDES, 1.0 - top)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.tile([0.0, 0.0, 1.0], (SIDES + 1, 1))
    here, following = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    lid = np.stack([np.full(SIDES, 3 * SIDES), 2 * SIDES + here, 2 * SIDES + following], axis=1)
    count = 3 * SIDES + 1
    return Mesh(
        positions=np.concatenate([foot, head, head, [[0.0, 0.0, 1.0]]]).astype(np.float32),
        normals=np.concatenate([side, side, up]).astype(np.float32),
        indices=np.concatenate([_walls(SIDES), lid]).astype(np.uint32),
        colours=np.ones((count, 3), dtype=np.float32),
        surface=np.tile(np.array([115, 60, 1], dtype=np.uint8), (count, 1)),
    )


def _lying(tube: Mesh) -> Mesh:
    """The tube along x: its z becomes x, its x becomes −z."""

    def turned(vectors: Float32Array) -> Float32Array:
        return np.ascontiguousarray(np.stack([vectors[:, 2], vectors[:, 1], -vectors[:, 0]], axis=1))

    return Mesh(turned(tube.positions), turned(tube.normals), tube.indices, tube.colours, tube.surface)
