"""Objects that cracks start at or run along (`Defect.beside`): covers, patches, trenches, joints."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.defects.context import Feature, start_of
from pavetwin.scene.ground.layout.lines import direction
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Defect, Segment
from pavetwin.world.pavement_joints import joints_across, joints_along, lane_joints
from pavetwin.world.segments import direction_at, point_at

KEY: Final = 16  # Key of this module's children of the scene's random stream
SAME_JOINT_M: Final = 0.3  # Cracks nearer to each other than this lie along one joint
GAP_M: Final = 0.06
"""From the outline of a crack to the model that it starts at: that must not touch the patch of the crack."""

PATCH_HALF_M: Final = (0.35, 1.1)
TRENCH_HALF_M: Final = (0.26, 0.5)
TONES: Final = (0.66, 0.93)
"""Half the sides of patches, half the width of trenches [m], and the factor on the reflectance around them: as of other
repairs (`repairs`)."""


def cover_places(layout: SurfaceLayout, reach_m: float) -> Iterator[tuple[float, float, float]]:
    """Middle x and y and direction of the covers that cracks start at, world frame.

    Args:
        reach_m: radius of the covers.
    """
    for defect, rng in _beside(layout, Feature.COVER):
        start, away = start_of(defect.polygon, defect.yaw_rad)
        x, y = start + away * (reach_m + GAP_M)
        yield float(x), float(y), float(rng.uniform(0.0, 2 * np.pi))


def patch_bars(layout: SurfaceLayout) -> Iterator[tuple[float, ...]]:
    """The patches and trenches, as `Repairs` holds them."""
    for defect, rng in _beside(layout, Feature.PATCH):
        start, away = start_of(defect.polygon, defect.yaw_rad)
        line = layout.world.segment(defect.segment).centre_line
        dx, dy = direction(line, line.project(defect.centre))
        # Square to the street, so that the crack meets the corner between the sides that face it.
        ahead, street = np.arctan2(away[1], away[0]), np.arctan2(dy, dx)
        turn = float(street + np.pi / 2 * np.ceil((ahead - street) / (np.pi / 2)))
        half = rng.uniform(*PATCH_HALF_M), rng.uniform(*PATCH_HALF_M)
        middle = start + _turned(np.array([half[0], -half[1]]), turn)
        yield (*map(float, middle), turn, *map(float, half), float(rng.uniform(*TONES)))
    for defect, rng in _beside(layout, Feature.TRENCH):
        low, high = np.array([defect.polygon.bounds[:2], defect.polygon.bounds[2:]])
        reach = float(np.hypot(*(high - low))) / 2 + rng.uniform(0.3, 2.5)
        wide = float(rng.uniform(*TRENCH_HALF_M))
        middle = np.array([defect.centre.x, defect.centre.y]) + _turned(np.array([0.0, -wide]), defect.yaw_rad)
        yield (*map(float, middle), defect.yaw_rad, reach, wide, float(rng.uniform(*TONES)))


def lane_joints_cracked(layout: SurfaceLayout, segment: Segment) -> list[float]:
    """Offsets to the left of a segment's centre line of the joints between lanes along which cracks run."""
    joints, (_, lefts) = lane_joints(segment), _in_street(layout, segment, Feature.LANE_JOINT)
    return sorted({float(joints[np.argmin(np.abs(joints - left))]) for left in lefts})


@dataclass(frozen=True)
class SlabCracks:
    """Where on a segment cracks run along joints between slabs: stations of joints across, offsets of those along."""

    stations: tuple[float, ...]
    lefts: tuple[float, ...]

    @classmethod
    def of(cls, layout: SurfaceLayout, segment: Segment) -> Self:
        across, _ = _in_street(layout, segment, Feature.SLAB_JOINT, is_across=True)
        _, along = _in_street(layout, segment, Feature.SLAB_JOINT, is_across=False)
        _, lanes = _in_street(layout, segment, Feature.LANE_JOINT)
        corners = _in_street(layout, segment, Feature.SLAB_CORNER)
        across += _nearest(joints_across(segment), corners[0])
        return cls(tuple(across), (*along, *lanes, *_nearest(joints_along(segment), corners[1])))

    def across(self, joints: Float64Array) -> Float64Array:
        """Joints across a street, the nearest to a crack moved to it: slabs of a style may have another length."""
        return _moved(joints, self.stations)

    def along(self, joints: Float64Array) -> Float64Array:
        """The same of joints along it."""
        return _moved(joints, self.lefts)


def _nearest(joints: Float64Array, cracks: list[float]) -> list[float]:
    """The joint nearest to each crack, at most half a slab away."""
    return [float(joints[np.argmin(np.abs(joints - at))]) for at in cracks]


def _moved(joints: Float64Array, cracks: tuple[float, ...]) -> Float64Array:
    """The joints without those that are within half a slab of a crack, and one at each crack."""
    if not cracks:
        return joints
    at = np.sort(cracks)
    at = at[np.diff(at, prepend=-np.inf) > SAME_JOINT_M]
    half = float(np.diff(joints).min()) / 2 if len(joints) > 1 else np.inf
    free = joints[np.abs(joints[:, None] - at).min(axis=1) >= half]
    return np.sort(np.concatenate([free, at]))


def _in_street(
    layout: SurfaceLayout, segment: Segment, feature: Feature, is_across: bool | None = None
) -> tuple[list[float], list[float]]:
    """Stations, and offsets to the left, of the cracks of a segment along a feature; of those across it or along it."""
    stations: list[float] = []
    lefts: list[float] = []
    for defect in layout.world.defects_of(segment.id):
        if defect.beside != feature.value:
            continue
        station = float(segment.centre_line.project(defect.centre))
        dx, dy = direction_at(segment.centre_line, station)
        x, y = point_at(segment.centre_line, station)
        lies_across = abs(np.cos(defect.yaw_rad) * dx + np.sin(defect.yaw_rad) * dy) < 0.7
        if is_across is None or lies_across == is_across:
            stations.append(station)
            lefts.append(float((defect.centre.y - y) * dx - (defect.centre.x - x) * dy))
    return stations, lefts


def _beside(layout: SurfaceLayout, feature: Feature) -> Iterator[tuple[Defect, np.random.Generator]]:
    for defect in layout.world.defects:
        if defect.beside == feature.value:
            yield defect, child(layout.seed, Stream.SCENE, KEY, defect.seed)


def _turned(point: Float64Array, turn_rad: float) -> Float64Array:
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.array([cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]])
