"""Courses of sealed and open joints: their irregularity, and their gaps at defects."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout

CLEAR_OF_DEFECTS_M: Final = 0.03
"""Nothing is sealed this near to the patch of a defect, or the seal would hide the defect."""

SLENDER_M: Final = 0.13
"""Patches that are nowhere farther from their border are those of single cracks: up to 8 cm wide with their broken
edges, and 4 cm beside. Of two real towns' 1157 single cracks 97 in 100 are, and 1 in 100 potholes."""

RUNS_ON_M: Final = 0.35
"""A seal runs on over a single crack that it crosses within this length: a road's joints do not end at every crack."""

SHORTEST_M: Final = 0.4
"""Shorter remains are left out."""


def clear_of_defects(plan: SurfaceLayout, line: Float64Array) -> Iterator[Float64Array]:
    """The parts of a line (n, 2) that hide no defect, world frame."""
    path = LineString(line)
    near = [hole for hole in plan.holes.at(path, CLEAR_OF_DEFECTS_M) if not _runs_on(path, hole)]
    free = shapely.difference(path, shapely.union_all(near).buffer(CLEAR_OF_DEFECTS_M)) if near else path
    for part in shapely.get_parts(free):
        if part.length > SHORTEST_M:
            yield shapely.get_coordinates(part)


def _runs_on(path: LineString, hole: BaseGeometry) -> bool:
    """Whether a line only crosses a patch, and that of a single crack."""
    return bool(shapely.intersection(path, hole).length < RUNS_ON_M and hole.buffer(-SLENDER_M).is_empty)


def wavering(rng: np.random.Generator, a: Float64Array, b: Float64Array, sway: float) -> Float64Array:
    """A slightly irregular line from one point to another."""
    length = float(np.hypot(*(b - a)))
    stations = np.linspace(0.0, length, max(3, int(length / 0.35)))
    along = (b - a) / max(length, 1e-9)
    left = np.array([-along[1], along[0]])
    return np.asarray(a + along * stations[:, None] + left * wander(rng, stations, sway)[:, None])


def wander(rng: np.random.Generator, stations: Float64Array, sway: float) -> Float64Array:
    """Offsets of a line from the straight one, standard deviation `sway` [m], corrected about every metre."""
    waves = np.array([0.9, 2.3, 6.1])[:, None]
    phases = rng.uniform(0.0, 2 * np.pi, (3, 1))
    swing = np.array([0.4, 0.8, 1.1]) @ np.sin(2 * np.pi * stations / waves + phases)
    return np.asarray(sway * swing + rng.normal(0.0, 0.2 * sway, len(stations)))
