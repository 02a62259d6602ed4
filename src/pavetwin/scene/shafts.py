"""Procedural cylinders for masts, arms and posts: unit shapes that instances scale."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.scene.model import Mesh, Model

SIDES: Final = 12
TAPER: Final = 0.62
"""Of a tapered mast: its radius at the top over that at the foot."""

SHAFT: Final = "shaft"
"""Parts `straight` and `tapered`: upright, radius 1 and height 1, open below. Part `level`: from the origin along x."""


@cache
def shafts() -> Mapping[str, Model]:
    """The procedural models, by name. Their colour is slot 1, white."""
    upright = {"straight": _tube(1.0), "tapered": _tube(TAPER)}
    return MappingProxyType({SHAFT: Model(SHAFT, MappingProxyType({**upright, "level": _lying(_tube(1.0))}))})


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
    walls = np.concatenate(
        [
            np.stack([here, following, SIDES + following], axis=1),
            np.stack([here, SIDES + following, SIDES + here], axis=1),
        ]
    )
    lid = np.stack([np.full(SIDES, 3 * SIDES), 2 * SIDES + here, 2 * SIDES + following], axis=1)
    count = 3 * SIDES + 1
    return Mesh(
        positions=np.concatenate([foot, head, head, [[0.0, 0.0, 1.0]]]).astype(np.float32),
        normals=np.concatenate([side, side, up]).astype(np.float32),
        indices=np.concatenate([walls, lid]).astype(np.uint32),
        colours=np.ones((count, 3), dtype=np.float32),
        surface=np.tile(np.array([115, 60, 1], dtype=np.uint8), (count, 1)),
    )


def _lying(tube: Mesh) -> Mesh:
    """The tube along x: its z becomes x, its x becomes −z."""

    def turned(vectors: Float32Array) -> Float32Array:
        return np.ascontiguousarray(np.stack([vectors[:, 2], vectors[:, 1], -vectors[:, 0]], axis=1))

    return Mesh(turned(tube.positions), turned(tube.normals), tube.indices, tube.colours, tube.surface)
