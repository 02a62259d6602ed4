"""Pose samplers shared by defect classes: where on a road a class occurs.

A sampler proposes poses on a road: (n, 3) rows of the share of the road's length [0, 1), the offset from its centre
line to the left [m], and the angle from the road's direction to the defect's own x axis, anticlockwise [rad].
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Segment


class Position(StrEnum):
    """Position and direction on a road in which a population places a defect."""

    JOINT = "joint"
    """Along a joint between paved lanes."""
    WHEEL_PATH = "wheel_path"
    """Along a wheel path."""
    EDGE = "edge"
    """Along an edge of the carriageway."""
    ACROSS = "across"
    """Transverse, anywhere on the road."""
    OBLIQUE = "oblique"
    """Diagonal, at about 45° to the road, anywhere."""
    ANYWHERE = "anywhere"
    """Anywhere, in any direction."""


Poses = Float64Array
"""(n, 3): share of the way along the road, 0 … 1; metres to the left of its middle; angle to it [rad]."""

WHEEL_PATH_M, WHEEL_PATH_SPREAD_M = 0.82, 0.10
"""Distance of wheel paths from a lane's centre: half the track width of cars and vans (1.5 to 1.8 m); its spread."""

NARROW_LANE_M = 2.6
"""Below this lane width the wheel paths move inwards with the width."""

EDGE_M = (0.25, 0.9)
"""Distance from the carriageway's edge to the strip of edge cracking, where lateral support is missing."""


ALONG_SPREAD_RAD, ACROSS_SPREAD_RAD, OBLIQUE_SPREAD_RAD = 0.035, 0.10, 0.22
"""Standard deviations of the directions of cracks along the road, across it, and oblique to it."""


@dataclass(frozen=True, slots=True)
class RoadSection:
    """The road section that a sampler proposes poses on."""

    length_m: float
    width_m: float
    lanes: int

    @classmethod
    def of(cls, segment: Segment) -> "RoadSection":
        return cls(segment.length_m, segment.width_m, max(1, segment.lanes))

    @property
    def lane_width_m(self) -> float:
        return self.width_m / self.lanes


PoseSampler = Callable[[np.random.Generator, RoadSection, int], Poses]
"""`sample_poses(rng, road, count)` proposes `count` poses for one defect."""


def wheel_paths(rng: np.random.Generator, road: RoadSection, count: int) -> Float64Array:
    """(count,) offsets in the wheel paths of lanes."""
    lane = rng.integers(road.lanes, size=count)
    centre = (lane + 0.5) * road.lane_width_m - road.width_m / 2
    narrow = min(1.0, road.lane_width_m / NARROW_LANE_M)
    side = rng.choice([-1.0, 1.0], size=count)
    return np.asarray(centre + side * narrow * rng.normal(WHEEL_PATH_M, WHEEL_PATH_SPREAD_M, count), dtype=np.float64)


def edges(rng: np.random.Generator, road: RoadSection, count: int) -> Float64Array:
    """(count,) offsets near the carriageway's edges."""
    side = rng.choice([-1.0, 1.0], size=count)
    return np.asarray(side * (road.width_m / 2 - rng.uniform(*EDGE_M, count)), dtype=np.float64)


def joints(rng: np.random.Generator, road: RoadSection, count: int) -> Float64Array:
    """(count,) offsets along the joints between paved lanes; a single lane is paved in two halves."""
    lanes = max(2, road.lanes)
    joint = rng.integers(1, lanes, size=count)
    return np.asarray(joint * road.width_m / lanes - road.width_m / 2 + rng.normal(0, 0.06, count), dtype=np.float64)


def anywhere(rng: np.random.Generator, road: RoadSection, count: int) -> Float64Array:
    """(count,) offsets over the whole width."""
    return np.asarray(rng.uniform(-road.width_m / 2, road.width_m / 2, count), dtype=np.float64)


def poses(rng: np.random.Generator, offsets: Float64Array, angle_rad: float, spread_rad: float) -> Poses:
    """Poses at the offsets, uniform along the road, rotated by about the angle, half of them reversed."""
    count = len(offsets)
    turn = rng.normal(angle_rad, spread_rad, count) + math.pi * rng.integers(2, size=count)
    return np.stack([rng.random(count), offsets, turn], axis=1)


def positioned(rng: np.random.Generator, position: Position, road: RoadSection, count: int) -> Poses:
    """Poses at a position."""
    match position:
        case Position.JOINT:
            return poses(rng, joints(rng, road, count), 0.0, ALONG_SPREAD_RAD)
        case Position.WHEEL_PATH:
            return poses(rng, wheel_paths(rng, road, count), 0.0, ALONG_SPREAD_RAD)
        case Position.EDGE:
            return poses(rng, edges(rng, road, count), 0.0, ALONG_SPREAD_RAD)
        case Position.ACROSS:
            return poses(rng, anywhere(rng, road, count), math.pi / 2, ACROSS_SPREAD_RAD)
        case Position.OBLIQUE:
            side = float(rng.choice([-1.0, 1.0]))
            return poses(rng, anywhere(rng, road, count), side * math.pi / 4, OBLIQUE_SPREAD_RAD)
        case Position.ANYWHERE:
            return poses(rng, anywhere(rng, road, count), 0.0, math.pi)
