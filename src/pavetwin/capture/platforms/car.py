"""A hatchback in the recorded traffic with two cameras: one ahead, over the bumper, and one down, behind the car.

On streets where no hatchback drives while traffic is recorded it takes the place of another car, or of another vehicle
where there is no car either: in a small town a street can be without hatchbacks for ten minutes.
"""

from collections.abc import Mapping
from functools import cached_property
from math import atan2, copysign, cos, radians, sin
from typing import Final

import numpy as np
import shapely

from pavetwin.arrays import IndexArray
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.platforms.platform import Platform, Pose, platform
from pavetwin.scene.view import look
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import World

KIND: Final = "hatchback"

FRONT_SHARE: Final = 0.7  # Share of images from the front camera; the others are from the rear camera
_LEAST_SPEED_MPS: Final = 0.5  # Below this speed the car counts as waiting: its images would repeat
_PITCHING_RAD: Final = radians(0.7)  # Standard deviation of the body's pitch on its springs

_WANDER_M: Final = 0.15
"""Standard deviation of the lateral offset from SUMO's path, the lane's centre line. By judgement."""

_YAWING_RAD, _HEAVING_M = radians(0.6), 0.015
"""Standard deviations of the body's yaw relative to its path, and of its height on its springs."""

_AHEAD_M: Final = 12.0
"""An image without defects from the front camera must have road at this distance ahead; this excludes cars that turn
around where the map ends."""

_STREET_M: Final = 2.0  # A car within this distance of a carriageway of a split is on one of its junctions


class Mount:
    """A camera on the car: where it is in the car's frame (x forward from the middle, z up), and its field of view."""

    def __init__(self, name: str, x_m: float, z_m: float, pitch_deg: float, vertical_fov_deg: float) -> None:
        self.name, self.x_m, self.z_m, self.pitch_rad = name, x_m, z_m, radians(pitch_deg)
        self.camera = Camera(
            title=f"PaveTwin car, {name} camera", image_px=(1280, 960), vertical_fov_deg=vertical_fov_deg
        )

    def ahead_m(self, length_m: float) -> float:
        """Its distance ahead of the middle of a vehicle of that length, with the hatchback's distance from the end
        [m]."""
        return self.x_m + copysign(1.0, self.x_m) * (length_m - KINDS[KIND].length_m) / 2


FRONT: Final = Mount("front", x_m=1.80, z_m=1.30, pitch_deg=-22.0, vertical_fov_deg=58.0)
"""On a bracket over the front bumper, as survey vehicles carry theirs, so that no bonnet hides the road. Pitched down:
the horizon is in the upper tenth of its image, the lower edge a metre ahead of the car."""

REAR: Final = Mount("rear", x_m=-3.30, z_m=2.00, pitch_deg=-90.0, vertical_fov_deg=74.0)
"""On an arm behind the tailgate, 2 m high as the line scanners of survey vehicles are. It sees a lane, 3 m, that begins
at the rear bumper: nearer to the car it would look at the ground below the body, where no camera sees any."""


@platform("car")
class Car(Platform):
    @classmethod
    def reaches(cls, world: World, recordings: Mapping[str, Recording]) -> set[str]:
        driven = [set(_ways(world, recording, within_m=0.0)) for recording in recordings.values()]
        return set.intersection(*driven)

    def propose(self, spec: ImageSpec, rng: np.random.Generator) -> Pose | None:
        # The front camera seldom sees a road without defects; images without defects may come from either camera.
        mount = FRONT if (spec.share if spec.aims else rng.random()) < FRONT_SHARE else REAR
        recording, rows = self.context.recordings[spec.density], self._rows[spec.density][spec.split]
        row = int(rows[int(rng.integers(len(rows)))])
        # The trace interpolates between two steps; if the car has left by then, another pose is drawn.
        step = int(np.searchsorted(recording.step_offsets, row, side="right")) - 1
        time_s = min((step + float(rng.random())) * recording.step_s, recording.duration_s)
        agent = int(recording.agent[row])
        poses = self.context.traces[spec.density].agents_at(time_s)
        there = np.flatnonzero(poses["agent"] == agent)
        if not len(there):
            return None
        x, y, yaw, east, north = (
            float(poses[name][there[0]]) for name in ("x_m", "y_m", "yaw_rad", "east_mps", "north_mps")
        )
        ahead_m = mount.ahead_m(float(recording.agents.length_m[agent]))
        pitching, aside, yawing, heaving = rng.standard_normal(4).tolist()
        pitch, aside_m = mount.pitch_rad + _PITCHING_RAD * pitching, _WANDER_M * aside
        heading = yaw + _YAWING_RAD * yawing
        view = look(
            (
                x + ahead_m * cos(yaw) - aside_m * sin(yaw),
                y + ahead_m * sin(yaw) + aside_m * cos(yaw),
                mount.z_m + _HEAVING_M * heaving,
            ),
            yaw_rad=heading,
            pitch_rad=pitch,
            size_px=self.context.settings.size_px,
            vertical_fov_rad=mount.camera.fov_rad,
            velocity_mps=(east, north, 0.0),
        )
        ahead = view.position[:2] + _AHEAD_M * np.array([cos(heading), sin(heading)])
        if mount is FRONT and not spec.aims and not shapely.contains_xy(self.context.defect_index.road, *ahead):
            return None
        return Pose(view, time_s, atan2(sin(heading), cos(heading)), pitch, mount.camera, mount.name, ego=agent)

    @cached_property
    def _rows(self) -> dict[str, dict[str, IndexArray]]:
        """By density and split: rows of the recording whose vehicle may carry the camera, on the split's streets;
        `reaches` ensures there are any."""
        return {name: self._of_splits(recording) for name, recording in self.context.recordings.items()}

    def _of_splits(self, recording: Recording) -> dict[str, IndexArray]:
        splits = self.context.defect_index.splits
        found: dict[str, list[IndexArray]] = {}
        for street, rows in _ways(self.context.world, recording, within_m=_STREET_M).items():
            if street in splits:
                found.setdefault(splits[street], []).append(rows)
        return {split: np.sort(np.concatenate(rows)) for split, rows in found.items()}


def _ways(world: World, recording: Recording, within_m: float) -> dict[str, IndexArray]:
    """Street → rows of the recording with a moving vehicle that the hatchback may replace.

    Args:
        within_m: how far off the carriageway, on a junction, counts as on the street.
    """
    ranks = np.array([_rank(kind) for kind in recording.agents.kind], dtype=np.intp)
    moves = (recording.speed_mps > _LEAST_SPEED_MPS) & ~recording.agents.is_pedestrian[recording.agent]
    rows = np.flatnonzero(moves)
    tree = shapely.STRtree([segment.polygon for segment in world.segments])
    places = shapely.points(recording.x[rows].astype(np.float64), recording.y[rows].astype(np.float64))
    point, nearest = tree.query_nearest(places, max_distance=max(within_m, 1e-6), all_matches=False)
    rows, streets = rows[point], np.array([segment.street for segment in world.segments], dtype=np.str_)[nearest]
    order = np.argsort(streets, kind="stable")
    names, starts = np.unique(streets[order], return_index=True)
    found = {}
    for name, here in zip(names.tolist(), np.split(rows[order], starts[1:]), strict=True):
        best = ranks[recording.agent[here]]
        found[name] = here[best == best.min()]
    return found


def _rank(kind: str) -> int:
    """Preference for a vehicle kind to carry the camera: on each street the lowest rank present is taken."""
    if kind == KIND:
        return 0
    return 1 if kind in KINDS and KINDS[kind].sumo_class == "passenger" else 2
