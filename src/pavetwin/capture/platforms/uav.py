"""The UAV's camera over a street: mostly nadir and along the street, as inspections are flown, with some variation.

Images without defects are taken of a person or vehicle of the recorded traffic, or of a part of the road far from every
defect.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import atan2, floor, log2, pi, radians, tan
from typing import Final, Self

import numpy as np
import shapely

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.capture.image_spec import INNER, ImageSpec
from pavetwin.capture.platforms.platform import CaptureContext, Platform, Pose, platform
from pavetwin.capture.splits import SAMPLED_S
from pavetwin.config.mission import CEILING_M, LOWEST_M
from pavetwin.scene.view import View, look
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import Segment
from pavetwin.world.segments import direction_at


@dataclass(frozen=True)
class Clearings:
    """The carriageway of some segments without what is near a defect, as triangles to sample points from."""

    corners: Float64Array
    """(n, 3, 2) metres, world frame."""
    owners: tuple[Segment, ...]
    """(n,) the segment of each."""

    @classmethod
    def of(cls, segments: Sequence[Segment], defects: shapely.STRtree, radius_m: float) -> Self:
        """The points from which a disc of that radius holds no defect: centres of images without defects."""
        parts, owners = [], []
        for segment in segments:
            near = defects.geometries[defects.query(segment.polygon, predicate="dwithin", distance=radius_m)]
            # Convex hulls are hardly larger than the outlines, and fifty times as fast to buffer.
            around = shapely.buffer(shapely.convex_hull(near), radius_m, quad_segs=4)
            clear = shapely.difference(segment.polygon, shapely.union_all(around))
            triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(clear))
            parts.append(shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3])
            owners += [segment] * len(triangles)
        return cls(np.concatenate([np.empty((0, 3, 2)), *parts]), tuple(owners))

    def draw(self, rng: np.random.Generator) -> tuple[Float64Array, Segment] | None:
        """A point (2,) drawn uniformly over the area, and its segment; None if there is no such area."""
        sides = self.corners[:, 1:] - self.corners[:, :1]
        areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        if not areas.sum() > 0:
            return None
        index = int(rng.choice(len(areas), p=areas / areas.sum()))
        shares = rng.random(2)
        # The half of the parallelogram beyond the triangle is folded back onto it (Turk 1990).
        shares = shares if shares.sum() <= 1 else 1 - shares
        return self.corners[index, 0] + shares @ sides[index], self.owners[index]


BESIDE_M: Final = 2.0  # People on a sidewalk are taken where the carriageway is this near
TRIES: Final = 50  # Road users that are drawn until one is far enough from every defect


@dataclass(frozen=True)
class RoadUser:
    """A person or vehicle at a time of the recording."""

    xy: Float64Array
    """(2,) metres, world frame."""
    time_s: float
    segment: Segment
    """The nearest."""


@dataclass(frozen=True)
class RoadUsers:
    """Samples of a recording on some segments. Arrays are (samples,), people first."""

    segments: Sequence[Segment]
    xy: Float64Array
    """(samples, 2) metres."""
    time_s: Float64Array
    nearest: IndexArray
    """Index into `segments`."""
    people: int
    """Number of samples that are people."""

    @classmethod
    def of(cls, recording: Recording, segments: Sequence[Segment]) -> Self:
        """Everyone on the segments or just off them, every ten seconds."""
        frames = np.arange(0, recording.frames, max(1, round(SAMPLED_S / recording.step_s)))
        first, last = recording.step_offsets[frames], recording.step_offsets[frames + 1]
        rows = np.concatenate([np.arange(*bounds) for bounds in zip(first, last, strict=True)])
        time_s = np.repeat(frames * recording.step_s, last - first)
        xy = np.column_stack([recording.x[rows], recording.y[rows]]).astype(np.float64)
        tree = shapely.STRtree([segment.polygon for segment in segments])
        inside, nearest = tree.query_nearest(shapely.points(xy), max_distance=BESIDE_M, all_matches=False)
        walks = recording.agents.is_pedestrian[recording.agent[rows[inside]]]
        order = np.argsort(~walks, kind="stable")
        inside, nearest = inside[order], nearest[order]
        return cls(segments, xy[inside], time_s[inside], nearest, int(walks.sum()))

    def draw(self, rng: np.random.Generator, defects: shapely.STRtree, radius_m: float) -> RoadUser | None:
        """One with no defect within a radius: half of them people, half vehicles; None if none was found.

        Args:
            defects: their outlines.
        """
        groups = [(0, self.people), (self.people, len(self.xy))]
        groups = [(first, last) for first, last in groups if last > first]
        for _ in range(TRIES if groups else 0):
            first, last = groups[int(rng.integers(len(groups)))]
            row = int(rng.integers(first, last))
            if not len(defects.query(shapely.Point(self.xy[row]), predicate="dwithin", distance=radius_m)):
                return RoadUser(self.xy[row], float(self.time_s[row]), self.segments[int(self.nearest[row])])
        return None


_ALONG, _ACROSS = 0.75, 0.15
"""Shares of images headed along the street, either way, and across it; the rest have a random heading."""

_SCATTER_RAD: Final = radians(8.0)
_NADIR: Final = 0.75  # Share of nadir images, with the gimbal's error; the others are tilted forward

_GIMBAL_RAD: Final = radians(0.5)
_TILT_RAD: Final = (radians(3.0), radians(20.0))
_HOVERING: Final = 0.25
_SPEED_MPS: Final = (2.0, 6.0)
"""Range of the images that are not taken while hovering: around the 5 m/s of an inspection."""

_CLEARINGS_AN_OCTAVE: Final = 4  # Steps of the ground resolution for which places without defects are prepared
_ROAD_M: Final = 1.0  # The middle of every image lies on the road, or at most this far off it


@dataclass(frozen=True)
class _Aim:
    """Target of an image."""

    xy: Float64Array
    """(2,) metres, world frame."""
    along_rad: float
    """Direction of its street."""
    time_s: float | None = None
    """Time of the recorded traffic; None: any."""
    centred: bool = False
    """True to centre it in the image; else it is anywhere in the inner part."""


@platform("uav")
class Uav(Platform):
    uses_altitude = True

    def __init__(self, context: CaptureContext) -> None:
        super().__init__(context)
        self._camera = find_camera(context.settings.camera)
        self._clearings: dict[tuple[str, float], Clearings] = {}
        self._road_users: dict[tuple[str, str], RoadUsers] = {}

    def propose(self, spec: ImageSpec, rng: np.random.Generator) -> Pose | None:
        aim = self._aimed_at(spec, rng) if spec.aims else self._road_user(spec, rng) or self._clear_place(spec, rng)
        if aim is None:
            return None
        heading = self._heading(aim.along_rad, rng)
        tilt = _GIMBAL_RAD * rng.standard_normal() if rng.random() < _NADIR else rng.uniform(*_TILT_RAD)
        pitch = -pi / 2 + float(tilt)
        speed = 0.0 if rng.random() < _HOVERING else float(rng.uniform(*_SPEED_MPS))
        place = np.full(2, 0.5) if aim.centred else rng.uniform(0.5 - INNER / 2, 0.5 + INNER / 2, size=2)
        size = self.context.settings.size_px
        view = look(
            (0.0, 0.0, spec.altitude_m or 1.0),
            yaw_rad=heading,
            pitch_rad=pitch,
            size_px=size if spec.gsd_mm is None else self._camera.image_px,
            vertical_fov_rad=self._camera.fov_rad,
            velocity_mps=speed * np.array([np.cos(heading), np.sin(heading), 0.0]),
        )
        if spec.gsd_mm is not None:
            view = _crop_of_resolution(view, size, spec.gsd_mm, rng)
        # The aim's ground position seen from above the origin gives the camera's position.
        xy, altitude_m = aim.xy - view.ground(place * size), float(view.position[2])
        if not np.isfinite(xy).all() or not LOWEST_M <= altitude_m <= CEILING_M:
            return None
        if not self.context.airspace.contains(float(xy[0]), float(xy[1]), altitude_m):
            return None
        view = replace(view, position=np.array([*xy, altitude_m]))
        if not shapely.dwithin(self.context.defect_index.road, shapely.Point(view.ground(np.array(size) / 2)), _ROAD_M):
            return None
        time_s = aim.time_s
        if time_s is None:
            time_s = float(rng.uniform(0.0, self.context.recordings[spec.density].duration_s))
        return Pose(view, time_s, heading, pitch, self._camera, mount="gimbal")

    def _aimed_at(self, spec: ImageSpec, rng: np.random.Generator) -> _Aim:
        """A defect that the image must show."""
        defect = self.context.world.defects[int(rng.choice(self.context.defect_index.candidates(spec)))]
        segment = self.context.world.segment(defect.segment)
        return _Aim(np.array([defect.centre.x, defect.centre.y]), _direction(segment, defect.centre))

    def _road_user(self, spec: ImageSpec, rng: np.random.Generator) -> _Aim | None:
        """A person or a vehicle, of an image that is to show one and no defect; None of other images."""
        if spec.share >= self.context.settings.road_users:
            return None
        key = spec.split, spec.density
        if key not in self._road_users:
            recording = self.context.recordings[spec.density]
            self._road_users[key] = RoadUsers.of(recording, self._of_split[spec.split])
        outlines = self.context.defect_index.outlines
        drawn = self._road_users[key].draw(rng, outlines, self._clear_radius_m(spec))
        if drawn is None:
            return None
        return _Aim(drawn.xy, _direction(drawn.segment, shapely.Point(drawn.xy)), drawn.time_s)

    def _clear_place(self, spec: ImageSpec, rng: np.random.Generator) -> _Aim | None:
        """The centre of an image that must show no defect."""
        key = spec.split, self._clear_radius_m(spec)
        if key not in self._clearings:
            self._clearings[key] = Clearings.of(self._of_split[spec.split], self.context.defect_index.outlines, key[1])
        drawn = self._clearings[key].draw(rng)
        return None if drawn is None else _Aim(drawn[0], _direction(drawn[1], shapely.Point(drawn[0])), centred=True)

    def _clear_radius_m(self, spec: ImageSpec) -> float:
        """Radius of a disc that lies within every nadir image of a spec, and nearly within every tilted one."""
        width, height = self.context.settings.size_px
        if spec.gsd_mm is None:
            assert spec.altitude_m is not None
            return spec.altitude_m * tan(self._camera.fov_rad / 2) * min(1.0, width / height)
        # In steps, so that few are prepared.
        step = floor(log2(spec.gsd_mm) * _CLEARINGS_AN_OCTAVE) / _CLEARINGS_AN_OCTAVE
        return float(2.0**step) / 1000 * min(width, height) / 2

    def _heading(self, along_rad: float, rng: np.random.Generator) -> float:
        how = rng.random()
        turn = pi * int(rng.integers(2))
        if how >= _ALONG:
            turn += pi / 2 if how < _ALONG + _ACROSS else float(rng.uniform(-pi, pi))
        return along_rad + turn + _SCATTER_RAD * float(rng.standard_normal())

    @cached_property
    def _of_split(self) -> dict[str, list[Segment]]:
        """The segments of each split's streets."""
        splits = self.context.defect_index.splits
        found: dict[str, list[Segment]] = {}
        for segment in self.context.world.segments:
            if segment.street in splits:
                found.setdefault(splits[segment.street], []).append(segment)
        return found


def _crop_of_resolution(view: View, size_px: tuple[int, int], gsd_mm: float, rng: np.random.Generator) -> View:
    """A crop anywhere in a view, which moves to the altitude that gives the crop's middle a ground resolution."""
    (width, height), (wide, high) = view.size_px, size_px
    corner = int(rng.integers(width - wide + 1)), int(rng.integers(height - high + 1))
    crop = view.crop(corner, size_px)
    finer = gsd_mm / 1000 / float(crop.ground_resolution_m(np.array(size_px) / 2))
    return replace(crop, position=crop.position * finer)


def _direction(segment: Segment, place: shapely.Point) -> float:
    """Direction of a segment next to a point [rad]."""
    dx, dy = direction_at(segment.centre_line, segment.centre_line.project(place))
    return atan2(dy, dx)
