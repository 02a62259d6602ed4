"""Features that cracks start at or run along: manhole covers, corners of patches and slabs, edges of trenches, joints.

A population's class may give the shares of its cracks to which this applies. Such a crack is placed as any other, where
there is room for both; its feature is kept with the defect, and a scene draws it there. So the cracks of a world do not
depend on a scene, and are exact in each. `pavetwin.world.pavement_joints` places the joints.

The end of a crack at which it starts is the one with the largest x of its own frame; trenches lie to the right of their
crack (smaller y).
"""

import math
from enum import StrEnum
from typing import Final, Self

import numpy as np
import shapely
from pydantic import model_validator
from shapely import Point, Polygon

from pavetwin.arrays import Float64Array
from pavetwin.config.settings import Settings, Share
from pavetwin.defects.poses import ALONG_SPREAD_RAD, Poses, Position, RoadSection, anywhere, poses, positioned
from pavetwin.defects.shapes import between
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Segment, ShapeParameters
from pavetwin.world.pavement_joints import (
    SLAB_M,
    has_slabs,
    is_paved_apart,
    joints_across,
    joints_along,
    lane_joints,
    slab_width_m,
)

COVER_ROOM_M: Final = 0.68
"""Radius of the room that is kept for a cover: the largest with its collar has 0.62 m."""

TRENCHES_ACROSS: Final = 0.6
"""Share of the trenches along cracks that lie across the street: connections of houses are more than mains. Ours."""


OVERGROWN: Final = (0.08, 0.8)
"""Shares of its length that are overgrown in an overgrown crack. Ours."""

JOINTS_ACROSS: Final = 0.7
"""Share of the cracks at joints between slabs that are at those across the street. Ours."""

CORNER_RAD: Final = (math.radians(30.0), math.radians(60.0))
"""Angles between the street and cracks across the corner of a slab. Ours."""

JOINT_SPREAD_RAD: Final = 0.004
"""Standard deviation of their direction from that of the joint."""

STRAIGHT: Final[ShapeParameters] = (("wander", 0.3), ("branches", 0.25))
"""Spread of cracks along joints, which hardly leave them, and of those across corners."""

_FEATURES, _POSES = 1, 2  # Keys of random numbers under the seed of a shape


class Feature(StrEnum):
    """Feature that a crack starts at, or runs along."""

    COVER = "cover"
    PATCH = "patch"
    TRENCH = "trench"
    SLAB_JOINT = "slab_joint"
    SLAB_CORNER = "slab_corner"
    LANE_JOINT = "lane_joint"

    def is_on(self, street: str) -> bool:
        """Whether the street of a name may have it."""
        match self:
            case Feature.SLAB_JOINT | Feature.SLAB_CORNER:
                return has_slabs(street)
            case Feature.LANE_JOINT:
                return is_paved_apart(street)
            case _:
                return True


_JOINTS: Final = (Feature.SLAB_JOINT, Feature.SLAB_CORNER, Feature.LANE_JOINT)


class CrackContext(Settings):
    """Shares of a class's defects that start at something; the others have their `positions`."""

    cover: Share = 0.0
    """Share that starts at the frame of a manhole cover."""
    patch: Share = 0.0
    """Share that starts obliquely at the corner of a patch."""
    trench: Share = 0.0
    """Share along the edge of a trench."""
    slab_joint: Share = 0.0
    """Share along a joint between two slabs, on streets of slabs."""
    slab_corner: Share = 0.0
    """Share across the corner of a slab (corner break), on streets of slabs."""
    lane_joint: Share = 0.0
    """Share along the joint between two lanes, on streets whose lanes were paved separately."""
    overgrown: Share = 0.0
    """Share with grass and moss in part of the length: the class parameter of this name."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.cover + self.patch + self.trench + max(self.slab_joint + self.slab_corner, self.lane_joint) > 1:
            raise ValueError("the shares of cover, patch, trench and of joints sum to more than 1")
        return self

    @property
    def along_joints(self) -> bool:
        """Whether some run along joints."""
        return max(self.slab_joint, self.slab_corner, self.lane_joint) > 0

    def draw(self, seed: int, street: str) -> tuple[Feature | None, ShapeParameters]:
        """Feature that a defect starts at, if any, and the parameters of what grows in it.

        Args:
            seed: of its shape; other defects do not depend on what is drawn here.
            street: the name of the street it is on.
        """
        rng = child(seed, Stream.DEFECTS, _FEATURES)
        number, plants = rng.random(2).tolist()
        grown = ("overgrown", float(f"{between(rng, OVERGROWN):.4g}"))
        parameters = (grown,) if plants < self.overgrown else ()
        for feature in filter(lambda each: each.is_on(street), Feature):
            number -= getattr(self, feature.value)
            if number < 0:
                return feature, (*STRAIGHT, *parameters) if feature in _JOINTS else parameters
        return None, parameters


def poses_at(seed: int, feature: Feature, segment: Segment, count: int, length_m: float) -> Poses:
    """Poses of a defect of a length that starts at a feature; `seed` is that of its shape."""
    rng = child(seed, Stream.DEFECTS, _POSES)
    road = RoadSection.of(segment)
    match feature:
        case Feature.SLAB_JOINT if rng.random() < JOINTS_ACROSS and len(joints := joints_across(segment)):
            found = poses(rng, anywhere(rng, road, count), math.pi / 2, JOINT_SPREAD_RAD)
            found[:, 0] = rng.choice(joints, count) / segment.length_m
            return found
        case Feature.SLAB_JOINT if len(joints := joints_along(segment)):
            return poses(rng, rng.choice(joints, count), 0.0, JOINT_SPREAD_RAD)
        case Feature.LANE_JOINT:
            return poses(rng, rng.choice(lane_joints(segment), count), 0.0, JOINT_SPREAD_RAD)
        case Feature.SLAB_CORNER:
            return _across_corners(rng, segment, count, length_m)
        case Feature.SLAB_JOINT:
            return np.empty((0, 3))
        case Feature.COVER:
            return positioned(rng, Position.ANYWHERE, road, count)
        case Feature.PATCH:
            return positioned(rng, Position.OBLIQUE, road, count)
        case Feature.TRENCH if rng.random() < TRENCHES_ACROSS:
            return positioned(rng, Position.ACROSS, road, count)
        case _:
            return poses(rng, anywhere(rng, road, count), 0.0, ALONG_SPREAD_RAD)


def _across_corners(rng: np.random.Generator, segment: Segment, count: int, length_m: float) -> Poses:
    """Poses across corners of slabs, with both ends at a joint at most half a slab from the corner (ASTM D6433: farther
    away it is a linear crack); none for a defect that is too long, or without corners of four slabs."""
    across, along = joints_across(segment), joints_along(segment)
    angle = rng.uniform(*CORNER_RAD, count)
    legs = length_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fits = (legs <= (SLAB_M / 2, slab_width_m(segment) / 2)).all(axis=1)
    if not (len(across) and len(along) and fits.any()):
        return np.empty((0, 3))
    angle, legs = angle[fits], legs[fits]
    ahead, left = rng.choice([-1.0, 1.0], (2, len(angle)))
    stations = rng.choice(across, len(angle)) + ahead * legs[:, 0] / 2
    offsets = rng.choice(along, len(angle)) + left * legs[:, 1] / 2
    inside = (stations > 0) & (stations < segment.length_m)
    found = np.stack([stations / segment.length_m, offsets, -ahead * left * angle], axis=1)
    return np.asarray(found[inside], dtype=np.float64)


def start_of(outline: Polygon, yaw_rad: float) -> tuple[Float64Array, Float64Array]:
    """Starting point (2,) of a defect with an outline and a direction, world frame, and the unit vector (2,) away from
    it."""
    corners = shapely.get_coordinates(outline)
    away = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    return np.asarray(corners[int(np.argmax(corners @ away))]), away


def room_for(feature: Feature, outline: Polygon, yaw_rad: float) -> Polygon | None:
    """The room that a feature needs next to a defect, free of others; None if it needs none, as patches lie in the
    pavement."""
    if feature is not Feature.COVER:
        return None
    start, away = start_of(outline, yaw_rad)
    return Point(start + away * COVER_ROOM_M).buffer(COVER_ROOM_M, quad_segs=6)
