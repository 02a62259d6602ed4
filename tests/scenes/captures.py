"""A flight down the street of a tiny scene: its captures by the kernel, and the defects in them."""

from collections.abc import Iterator

import numpy as np
import shapely

from pavetwin._core import Arrived, Captured, Trace
from pavetwin.mission.environment import new_flight
from pavetwin.scene.view import View
from pavetwin.world.model import Defect
from scenes.tiny import Scene


def captures(scene: Scene, north_m: float, *options: str) -> Iterator[tuple[Captured, Trace]]:
    """Captures of whole pictures, from `north_m` off the first street's middle to as far beyond it."""
    settings = scene.settings(
        "camera.window_rows=1.0",
        "camera.window_columns=1.0",
        "camera.window_across_per_altitude=null",
        "camera.capture_interval_s=3.0",
        "sensing.min_visible_fraction=0.0",
        *options,
    )
    trace = scene.traffic(120).trace()
    flight = new_flight(scene.environment(settings), trace, settings)
    flight.climb_to(scene.altitude_m)
    while not isinstance(flight.advance(), Arrived):
        pass
    flight.fly_to((5.0, north_m))
    while not isinstance(flight.advance(), Arrived):
        pass
    flight.inspect(0, np.array([[5.0, north_m], [scene.world.segments[0].centre_line.length - 10, -north_m]]))
    while not isinstance(event := flight.advance(), Arrived):
        if isinstance(event, Captured):
            yield event, trace


def outline_px(view: View, defect: Defect) -> np.ndarray:
    """(n, 2) where the outline lies in the picture."""
    ring = shapely.get_coordinates(defect.polygon.exterior)
    return view.project(np.column_stack([ring, np.zeros(len(ring))]))


def is_whole(view: View, defect: Defect) -> bool:
    pixels = outline_px(view, defect)
    return bool((pixels > 1).all() and (pixels < np.array(view.size_px) - 1).all())
