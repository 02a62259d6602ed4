"""Static objects as vertical prisms with convex bases: buildings and furniture, which occlude the road and obstruct
the UAV, and parked vehicles."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array, Int64Array, UInt8Array
from pavetwin.world.model import Building, Furniture, FurnitureKind, World

ARM_HALF_HEIGHT_M = 0.15
"""An arm reaches this far above and below its height [m]."""

ARM_HALF_WIDTH_M = 0.1
PLATE_WIDTH_M, PLATE_HALF_DEPTH_M, PLATE_BOTTOM_M = 0.75, 0.03, 0.7
"""A sign's width, half its thickness, and how far below the mast's top it begins [m]."""

TRUNK_RADIUS_M = 0.2
CROWN_SIDES, MAST_SIDES = 12, 8

Ring = Float64Array
"""(n, 2) corners of a polygon, anticlockwise, each once, world frame."""
Prism = tuple[Ring, float, float]


class SolidKind(IntEnum):
    BUILDING = 0
    TRUNK = 1
    CROWN = 2
    MAST = 3
    ARM = 4
    SIGN = 5
    PARKED_VEHICLE = 6


@dataclass(frozen=True)
class Solids:
    """n upright prisms. The base of prism i is `xy[offsets[i]:offsets[i + 1]]`: convex, anticlockwise, not closed."""

    offsets: Int64Array
    """(n + 1,)"""
    xy: Float64Array
    """(offsets[n], 2), metres, world frame."""
    z0: Float64Array
    """(n,) bottom above ground, metres."""
    z1: Float64Array
    """(n,) top above ground, metres."""
    kind: UInt8Array
    """(n,) values of `SolidKind`."""

    def __post_init__(self) -> None:
        count = len(self.z0)
        if self.offsets.shape != (count + 1,) or self.z1.shape != (count,) or self.kind.shape != (count,):
            raise ValueError("offsets, z0, z1 and kind of solids do not belong together")
        if self.xy.shape != (int(self.offsets[-1]), 2):
            raise ValueError(f"the bases of solids have shape {self.xy.shape}, expected ({self.offsets[-1]}, 2)")
        if not (self.z1 >= self.z0).all():
            raise ValueError("a solid's top is below its bottom")

    def __len__(self) -> int:
        return len(self.z0)

    def with_others(self, other: "Solids") -> "Solids":
        """These, and others after them."""
        return Solids(
            offsets=np.concatenate([self.offsets, self.offsets[-1] + other.offsets[1:]]),
            xy=np.concatenate([self.xy, other.xy]),
            z0=np.concatenate([self.z0, other.z0]),
            z1=np.concatenate([self.z1, other.z1]),
            kind=np.concatenate([self.kind, other.kind]),
        )

    def base(self, index: int) -> Ring:
        """The base (k, 2) of one prism."""
        return self.xy[self.offsets[index] : self.offsets[index + 1]]

    def between(self, low_m: float, high_m: float) -> Int64Array:
        """Indices of the prisms that reach into a range of heights."""
        return np.flatnonzero((self.z0 < high_m) & (self.z1 > low_m))


def solids(world: World) -> Solids:
    """The prisms of a world's buildings and furniture, in that order."""
    prisms: list[tuple[SolidKind, Prism]] = []
    for building in world.buildings:
        prisms += [(SolidKind.BUILDING, (ring, 0.0, building.height_m)) for ring in convex_parts(building)]
    for thing in world.furniture:
        prisms += furniture_prisms(thing)
    sizes = [len(ring) for _, (ring, _, _) in prisms]
    return Solids(
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        xy=np.concatenate([ring for _, (ring, _, _) in prisms]) if prisms else np.empty((0, 2)),
        z0=np.array([low for _, (_, low, _) in prisms], dtype=np.float64),
        z1=np.array([high for _, (_, _, high) in prisms], dtype=np.float64),
        kind=np.array([kind for kind, _ in prisms], dtype=np.uint8),
    )


def parked_boxes(
    xy: Float64Array, yaw_rad: Float64Array, length_m: Float64Array, width_m: Float64Array, height_m: Float64Array
) -> Solids:
    """The boxes of n parked vehicles on the ground.

    Args:
        xy: (n, 2) centres, metres, world frame.
        yaw_rad: (n,) directions of the length, anticlockwise from east.
        length_m: (n,), and so are `width_m` and `height_m`.
    """
    count = len(xy)
    ahead = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=1)
    along, left = ahead * (length_m / 2)[:, None], ahead[:, ::-1] * [-1, 1] * (width_m / 2)[:, None]
    corners = np.stack([along + left, left - along, -along - left, along - left], axis=1)
    return Solids(
        offsets=np.arange(count + 1, dtype=np.int64) * 4,
        xy=(xy[:, None] + corners).reshape(-1, 2),
        z0=np.zeros(count),
        z1=np.asarray(height_m, dtype=np.float64),
        kind=np.full(count, SolidKind.PARKED_VEHICLE, dtype=np.uint8),
    )


def convex_parts(building: Building) -> Iterator[Ring]:
    """A building's footprint as convex rings: itself when it is convex, else its Delaunay triangles."""
    footprint = building.polygon
    if not footprint.interiors and footprint.convex_hull.area - footprint.area < 1e-6:
        yield _ring(footprint.convex_hull)
        return
    for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(footprint)):
        if triangle.area > 1e-9:
            yield _ring(triangle)


def furniture_prisms(thing: Furniture) -> list[tuple[SolidKind, Prism]]:
    """Trunk and crown of a tree; mast, arm and plate of everything else."""
    if thing.kind is FurnitureKind.TREE:
        trunk = _round(thing, min(TRUNK_RADIUS_M, thing.radius_m / 2), MAST_SIDES)
        crown = _round(thing, thing.radius_m, CROWN_SIDES)
        leaves = (SolidKind.CROWN, (crown, thing.clear_height_m, thing.height_m))
        stem = (SolidKind.TRUNK, (trunk, 0.0, thing.clear_height_m))
        return [stem, leaves] if thing.clear_height_m > 0 else [leaves]
    prisms = [(SolidKind.MAST, (_round(thing, thing.radius_m, MAST_SIDES), 0.0, thing.height_m))]
    if thing.arm_m > 0:
        arm = _box(thing, 0.0, thing.arm_m, ARM_HALF_WIDTH_M)
        prisms.append((SolidKind.ARM, (arm, thing.height_m - ARM_HALF_HEIGHT_M, thing.height_m + ARM_HALF_HEIGHT_M)))
    if thing.kind is FurnitureKind.SIGN:
        plate = _box(thing, -PLATE_WIDTH_M / 2, PLATE_WIDTH_M / 2, PLATE_HALF_DEPTH_M)
        prisms.append((SolidKind.SIGN, (plate, max(0.0, thing.height_m - PLATE_BOTTOM_M), thing.height_m)))
    return prisms


def _ring(polygon: shapely.Geometry) -> Ring:
    if not isinstance(polygon, Polygon):
        raise TypeError(f"expected a polygon, got {type(polygon).__name__}")
    ring = np.asarray(polygon.exterior.coords, dtype=np.float64)[:-1, :2]
    return ring if polygon.exterior.is_ccw else ring[::-1]


def _round(thing: Furniture, radius_m: float, sides: int) -> Ring:
    """A regular polygon around a thing's position whose corners lie on the circle."""
    angles = 2 * math.pi * np.arange(sides) / sides
    centre = np.array([thing.position.x, thing.position.y])
    return np.asarray(centre + radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1), dtype=np.float64)


def _box(thing: Furniture, start_m: float, end_m: float, half_width_m: float) -> Ring:
    """A rectangle along a thing's yaw, from `start_m` to `end_m` of its position."""
    along = np.array([math.cos(thing.yaw_rad), math.sin(thing.yaw_rad)])
    left = np.array([-along[1], along[0]]) * half_width_m
    centre = np.array([thing.position.x, thing.position.y])
    start, end = centre + along * start_m, centre + along * end_m
    return np.stack([start - left, end - left, end + left, start + left])
