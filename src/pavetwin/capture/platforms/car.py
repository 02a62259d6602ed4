"""A hatchback in the recorded traffic with two cameras: one behind the windscreen, and one down, behind the car."""

from functools import cached_property
from math import atan2, cos, radians, sin
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from pavetwin.capture.plan import Wish
from pavetwin.capture.platforms.base import Platform, Pose, platform
from pavetwin.errors import PaveTwinError
from pavetwin.scene.view import look
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import Camera

KIND: Final = "hatchback"

FRONT_SHARE: Final = 0.7
"""Of all images; the others are the rear camera's."""

_LEAST_SPEED_MPS: Final = 0.5
"""A car that waits would take the same image again and again."""

_PITCHING_RAD: Final = radians(0.7)
"""Standard deviation of the body's pitch on its springs."""

_STREET_M: Final = 2.0
"""A car this far off every carriageway of a split is on a junction."""


class Mount:
    """A camera on the car: where it is in the car's frame (x forward from the middle, z up), and its field of view."""

    def __init__(self, name: str, x_m: float, z_m: float, pitch_deg: float, vertical_fov_deg: float) -> None:
        self.name, self.x_m, self.z_m, self.pitch_rad = name, x_m, z_m, radians(pitch_deg)
        self.camera = Camera(
            title=f"PaveTwin car, {name} camera", image_px=(1280, 960), vertical_fov_deg=vertical_fov_deg
        )


FRONT: Final = Mount("front", x_m=0.55, z_m=1.30, pitch_deg=-22.0, vertical_fov_deg=58.0)
"""At the upper edge of the windscreen, pitched to the road: the horizon is in the upper tenth of its image."""

REAR: Final = Mount("rear", x_m=-2.30, z_m=2.00, pitch_deg=-90.0, vertical_fov_deg=80.0)
"""On an arm behind the tailgate, 2 m high as the line scanners of survey vehicles are: it sees a lane, 3.4 m."""


@platform("car")
class Car(Platform):
    def propose(self, wish: Wish, rng: np.random.Generator) -> Pose | None:
        mount = FRONT if wish.share < FRONT_SHARE else REAR
        recording, rows = self.setting.recordings[wish.density], self._rows(wish)
        row = int(rows[int(rng.integers(len(rows)))])
        # Between two steps the trace interpolates; where the car is gone by then, another is proposed.
        step = int(np.searchsorted(recording.step_offsets, row, side="right")) - 1
        time_s = min((step + float(rng.random())) * recording.step_s, recording.duration_s)
        agent = int(recording.agent[row])
        poses = self.setting.traces[wish.density].agents_at(time_s)
        there = np.flatnonzero(poses["agent"] == agent)
        if not len(there):
            return None
        x, y, yaw, east, north = (
            float(poses[name][there[0]]) for name in ("x_m", "y_m", "yaw_rad", "east_mps", "north_mps")
        )
        pitch = mount.pitch_rad + _PITCHING_RAD * float(rng.standard_normal())
        view = look(
            (x + mount.x_m * cos(yaw), y + mount.x_m * sin(yaw), mount.z_m),
            yaw_rad=yaw,
            pitch_rad=pitch,
            size_px=self.setting.settings.size_px,
            vertical_fov_rad=mount.camera.fov_rad,
            velocity_mps=(east, north, 0.0),
        )
        return Pose(view, time_s, atan2(sin(yaw), cos(yaw)), pitch, mount.camera, mount.name, ego=agent)

    def _rows(self, wish: Wish) -> npt.NDArray[np.intp]:
        """Rows of the recording with a moving hatchback on one of the split's streets.

        Raises:
            PaveTwinError: there is none.
        """
        rows = self._by_density[wish.density].get(wish.split, np.empty(0, dtype=np.intp))
        if not len(rows):
            raise PaveTwinError(
                f"No hatchback drives on the streets of {wish.split} in {wish.density} traffic; give a higher "
                "--density, another --seed, or --split 100/0/0."
            )
        return rows

    @cached_property
    def _by_density(self) -> dict[str, dict[str, npt.NDArray[np.intp]]]:
        return {name: self._of_splits(recording) for name, recording in self.setting.recordings.items()}

    def _of_splits(self, recording: Recording) -> dict[str, npt.NDArray[np.intp]]:
        is_ours = np.array([kind == KIND for kind in recording.agents.kind], dtype=np.bool_)
        rows = np.flatnonzero(is_ours[recording.agent] & (recording.speed_mps > _LEAST_SPEED_MPS))
        splits = self.setting.sight.splits
        segments = [segment for segment in self.setting.world.segments if segment.street in splits]
        places = shapely.points(recording.x[rows].astype(np.float64), recording.y[rows].astype(np.float64))
        tree = shapely.STRtree([segment.polygon for segment in segments])
        (point, nearest) = tree.query_nearest(places, max_distance=_STREET_M, all_matches=False)
        names = np.array([splits[segments[index].street] for index in nearest.tolist()], dtype=np.str_)
        return {name: rows[point[names == name]] for name in np.unique(names).tolist()}
