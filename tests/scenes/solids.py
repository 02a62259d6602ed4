"""Agents as the kernel's occluders: a box for a vehicle, an upright cylinder for a pedestrian.

Drawn in place of models, they let tests compare the renderer's visible fractions with the kernel's.
"""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.scene.values import TINTS, Instance, Mesh, Model, agent_label

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns

BOX: Final = "solid_box"
CYLINDER: Final = "solid_cylinder"
_SIDES: Final = 96


def solids() -> Mapping[str, Model]:
    """A unit box and a unit cylinder, to be scaled."""
    return {
        BOX: Model(BOX, {"body": _prism(np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]))}),
        CYLINDER: Model(CYLINDER, {"body": _prism(_circle())}),
    }


def as_solids(poses: "PoseColumns", label_of: Callable[[int], int] = agent_label) -> tuple[Instance, ...]:
    """The agents of the kernel's trace at one time, as it treats them as occluders."""
    tints = np.full((TINTS, 4), 0.4, dtype=np.float32)
    tints[:, 3] = 0
    found = []
    for row in range(len(poses["agent"])):
        walks = bool(poses["is_pedestrian"][row])
        width = float(poses["width_m"][row])
        size = (width if walks else float(poses["length_m"][row]), width, float(poses["height_m"][row]))
        yaw = float(poses["yaw_rad"][row])
        transform = np.eye(4)
        transform[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
        transform[:3, :3] *= size
        transform[:2, 3] = poses["x_m"][row], poses["y_m"][row]
        label = label_of(int(poses["agent"][row]))
        found.append(Instance(CYLINDER if walks else BOX, "body", transform, tints, label))
    return tuple(found)


def _circle() -> Float64Array:
    turns = np.arange(_SIDES) / _SIDES * 2 * math.pi
    return np.stack([np.cos(turns), np.sin(turns)], axis=1) / 2


def _prism(ring: Float64Array) -> Mesh:
    """A convex ring (n, 2), anticlockwise, from 0 to 1 m."""
    count = len(ring)
    after = np.roll(ring, -1, axis=0)
    outward = np.stack([after[:, 1] - ring[:, 1], ring[:, 0] - after[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)

    def at(points: Float64Array, z: float) -> Float64Array:
        return np.column_stack([points, np.full(count, z)])

    walls = np.stack([at(ring, 0), at(after, 0), at(after, 1), at(ring, 1)], axis=1).reshape(-1, 3)
    wall = np.arange(count)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])
    fan = np.stack([np.zeros(count - 2, dtype=int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    lid, floor = 4 * count + fan, 5 * count + fan[:, ::-1]
    return Mesh(
        np.concatenate([walls, at(ring, 1), at(ring, 0)]).astype(np.float32),
        np.concatenate([np.repeat(at(outward, 0), 4, axis=0), at(0 * ring, 1), at(0 * ring, -1)]).astype(np.float32),
        np.concatenate([wall.reshape(-1, 3), lid, floor]).astype(np.uint32),
        np.ones((6 * count, 3), dtype=np.float32),
        np.tile(np.array([150, 0, 1], dtype=np.uint8), (6 * count, 1)),
    )
