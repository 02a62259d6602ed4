"""Visibility of the ground: areas hidden by agents, and the pavement that captures have seen so far.

The camera is a point at the UAV; an agent is a box that stands on the ground, a pedestrian too. World frame, metres.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import hypot
from typing import TYPE_CHECKING, cast

import numpy as np
import shapely

from pavetwin.arrays import AnyArray, Float64Array, GeometryArray
from pavetwin.draw.marks import rectangles
from pavetwin.draw.mission_style import SMALLEST_VEHICLE_M
from pavetwin.mission.environment import window_m
from pavetwin.mission.timeline import Timeline

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns

LOWEST_M = 0.1
"""An agent as tall as the camera is high is cut this far below it: its shadow is then long, but finite."""

TOLERANCE_M = 0.05
"""Outlines of the seen pavement are simplified by this much."""


def bodies(agents: "PoseColumns") -> Float64Array:
    """(n, 4, 2) the agents' outlines on the ground."""
    return rectangles(agents["x_m"], agents["y_m"], agents["yaw_rad"], agents["width_m"], agents["length_m"])


def columns_near(agents: "PoseColumns", place: tuple[float, float], radius_m: float) -> "PoseColumns":
    """Those agents whose body may reach into a disc."""
    reach_m = radius_m + np.hypot(agents["length_m"], agents["width_m"]) / 2
    near = np.hypot(agents["x_m"] - place[0], agents["y_m"] - place[1]) <= reach_m
    return cast("PoseColumns", {name: column[near] for name, column in cast("dict[str, AnyArray]", agents).items()})


def shadows(agents: "PoseColumns", camera: tuple[float, float, float]) -> GeometryArray:
    """Polygons of ground that the agents on it hide from a camera at (east, north, height above the ground)."""
    standing = agents["is_pedestrian"] | (agents["length_m"] >= SMALLEST_VEHICLE_M)
    base = bodies(agents)[standing]
    eye, height_m = np.array(camera[:2]), camera[2]
    top_m = np.minimum(agents["height_m"][standing], height_m - LOWEST_M)
    top = eye + (base - eye) * (height_m / (height_m - top_m))[:, None, None]
    return np.asarray(shapely.convex_hull(shapely.multipoints(np.concatenate([base, top], axis=1))))


@dataclass
class SeenSurface:
    """The pavement of the inspected segments that the captures have seen, up to a time that only moves on."""

    timeline: Timeline
    concerns: Callable[[float, float], bool] = lambda _east, _north: True
    """Whether a capture at this place can come into the picture; the others are left out."""
    _done: int = field(default=0, init=False)
    _seen: shapely.Geometry = field(default_factory=shapely.Polygon, init=False)

    def until(self, time_s: float) -> shapely.Geometry:
        """Everything seen by captures up to `time_s`."""
        captures, count = self.timeline.captures, self.timeline.capture_count(time_s)
        news = [
            self._seen_by(number)
            for number in range(self._done, count)
            if self.concerns(float(captures["x_m"][number]), float(captures["y_m"][number]))
        ]
        self._done = max(self._done, count)
        if news:
            self._seen = shapely.simplify(shapely.union_all([self._seen, *news]), TOLERANCE_M)
        return self._seen

    def _seen_by(self, capture: int) -> shapely.Geometry:
        captures, size = self.timeline.captures, window_m(self.timeline.settings)
        east, north, yaw, time = (float(captures[name][capture]) for name in ("x_m", "y_m", "yaw_rad", "t_s"))
        window = shapely.Polygon(rectangles(east, north, yaw, *size))
        agents = self.timeline.trace.agents_near(east, north, hypot(*size) / 2 + 1, time)
        segment = self.timeline.environment.world.segments[int(captures["segment"][capture])]
        seen = shapely.intersection(window, segment.polygon)
        eye = (east, north, self.timeline.settings.altitude_m)
        parked = columns_near(self.timeline.parked, (east, north), hypot(*size) / 2 + 1)
        hidden = [*shadows(agents, eye), *shadows(parked, eye)]
        return shapely.difference(seen, shapely.union_all(hidden)) if hidden else seen
