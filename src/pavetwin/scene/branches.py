"""Trees without leaves: a trunk, boughs and twigs as segments, in a few forms that instances scale.

Each bough carries side shoots that are thinner by the square root of their number (Leonardo's rule: the areas of the
sections before and after a fork are equal; Minamino, Tateno 2014, PLoS ONE 9). Angles and lengths are ours.
"""

import math
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.scene.meshes import merged
from pavetwin.scene.models import BODY
from pavetwin.scene.shafts import THIN, rod
from pavetwin.scene.values import Mesh, Model
from pavetwin.scene.wires import between
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Furniture

FORMS: Final = 3
TRUNK: Final = 0.045
"""Radius of the trunk, × that of the crown."""

BOUGHS: Final = 7
SHOOTS: Final = (4, 3)
"""On each bough, and on each of those."""

SLIMMEST: Final = 0.0022
BARK: Final = (0.13, 0.115, 0.10)

KEY: Final = 102  # Key of the child of the scene's random stream that the forms are drawn from


@cache
def bare_trees() -> Mapping[str, Model]:
    """The models by name. Their frame is a crown's: radius 1, from 0 at the ground to 1 at the top."""
    return MappingProxyType(
        {f"bare_{form}": Model(f"bare_{form}", {BODY: _mesh(skeleton(form))}, {THIN: 1.0}) for form in range(FORMS)}
    )


@cache
def skeleton(form: int) -> Float64Array:
    """(n, 7) segments of a tree, as of `thin`, in the model's frame."""
    rng = child(1, Stream.SCENE, KEY, form)
    rows: list[Float64Array] = []
    fork = np.array([0.0, 0.0, 0.36])
    rows.append(np.array([0.0, 0.0, 0.0, *fork, TRUNK]))
    top = np.array([*rng.uniform(-0.06, 0.06, 2), 0.72])
    rows.append(np.array([*fork, *top, TRUNK * 0.7]))
    for number in range(BOUGHS):
        foot = fork + (top - fork) * (number / BOUGHS)
        turn = 2.4 * number + rng.uniform(-0.35, 0.35)
        reach = rng.uniform(0.6, 0.92) * (1.0 - 0.45 * number / BOUGHS)
        tip = foot + np.array([reach * math.cos(turn), reach * math.sin(turn), rng.uniform(0.16, 0.34)])
        _grow(rng, rows, foot, tip, TRUNK * 0.42, SHOOTS)
    return np.array(rows)


def bare_tree_of(item: Furniture, ground_m: float, form: int, yaw_rad: float) -> tuple[Float64Array, Float64Array]:
    """The transform (4, 4) of a form for a tree of the world, and its segments (n, 7) there."""
    cos, sin = math.cos(yaw_rad) * item.radius_m, math.sin(yaw_rad) * item.radius_m
    place = np.eye(4)
    place[:2, :2] = [[cos, -sin], [sin, cos]]
    place[2, 2] = item.height_m - ground_m
    place[:3, 3] = item.position.x, item.position.y, ground_m
    rows = skeleton(form)
    ends = [rows[:, first : first + 3] @ place[:3, :3].T + place[:3, 3] for first in (0, 3)]
    return place, np.column_stack([*ends, rows[:, 6] * item.radius_m])


def _grow(
    rng: np.random.Generator,
    rows: list[Float64Array],
    foot: Float64Array,
    tip: Float64Array,
    radius: float,
    shoots: tuple[int, ...],
) -> None:
    """A limb in two bent parts, and the shoots on it."""
    long = float(np.linalg.norm(tip - foot))
    bend = (foot + tip) / 2 + rng.normal(0.0, 0.06 * long, 3)
    rows.append(np.array([*foot, *bend, radius]))
    rows.append(np.array([*bend, *tip, max(0.7 * radius, SLIMMEST)]))
    if not shoots:
        return
    thinner = max(radius / math.sqrt(shoots[0]), SLIMMEST)
    for number in range(shoots[0]):
        share = 0.3 + 0.65 * (number + rng.uniform(0.0, 0.6)) / shoots[0]
        start = foot + (bend - foot) * 2 * share if share < 0.5 else bend + (tip - bend) * (2 * share - 1)
        ahead = (tip - foot) / long
        aside = np.cross(ahead, rng.normal(0.0, 1.0, 3))
        aside /= max(float(np.linalg.norm(aside)), 1e-6)
        way = 0.75 * ahead + rng.uniform(0.5, 0.9) * aside + np.array([0.0, 0.0, 0.15])
        end = start + way * (rng.uniform(0.3, 0.5) * long * (1.1 - 0.5 * share))
        flat = math.hypot(end[0], end[1])
        end[:2] *= min(1.0, 0.99 / max(flat, 1e-6))
        end[2] = min(end[2], 0.99)
        _grow(rng, rows, start, end, thinner, shoots[1:])


def _mesh(rows: Float64Array) -> Mesh:
    """All segments as rods."""
    parts = []
    for row in rows:
        place = between(row)
        turn = place[:3, :3] / np.linalg.norm(place[:3, :3], axis=0)
        unit = rod()
        moved = unit.positions.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
        normals = unit.normals.astype(np.float64) @ turn.T
        colours = np.tile(np.array(BARK, dtype=np.float32), (len(moved), 1))
        surface = np.tile(np.array([230, 0, 0], dtype=np.uint8), (len(moved), 1))
        parts.append(Mesh(moved.astype(np.float32), normals.astype(np.float32), unit.indices, colours, surface))
    return merged(parts)
