"""Places and times of the images, searched in the recording, so that no number is chosen manually."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from shapely import LineString, Polygon

from gallery.renderer import MORNING, GalleryRenderer
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import Defect
from pavetwin.world.segments import direction_at

TIMES = 60
MOST_DEFECTS = 12
CONSIDERED = 400
SIGHT_M = (160.0, 50.0)
"""Ahead and to each side, of a image along a street."""
MOST_PEDESTRIANS = 3
"""More add nothing to a image: crowds wait at corners, and hide no pavement."""


@dataclass(frozen=True)
class CameraPlacement:
    """A place over the street, the street's direction there, and a time of the recording."""

    x_m: float
    y_m: float
    yaw_rad: float
    time_s: float
    agent: int | None = None
    """The agent that carries the camera, if the image is taken from a vehicle."""


def shown_best(renderer: GalleryRenderer, kind: str, severity: str) -> Defect:
    """The widest and deepest defect of a class and severity among those in the morning's sun."""
    found = [defect for defect in renderer.world.defects if (defect.kind, defect.severity) == (kind, severity)]
    if not found:
        raise PaveTwinError(f"The town has no {kind} of {severity} severity; build it with another seed.")
    found = [defect for defect in found if _is_sunny(renderer, defect)] or found
    return max(found, key=lambda defect: (round(defect.width_m * defect.depth_m, 6), -defect.id))


def busy_street(renderer: GalleryRenderer) -> CameraPlacement:
    """Where most vehicles and people are within sight of a camera 15 m above broken pavement in the morning's sun."""
    ranked = sorted(_placements(renderer), key=lambda found: -found[0])
    return next((placement for _, placement, defect in ranked if _is_sunny(renderer, defect)), ranked[0][1])


def street_ahead(renderer: GalleryRenderer) -> CameraPlacement:
    """Of the busiest places, the one and the direction along its street with most houses ahead."""
    ranked = sorted(_placements(renderer), key=lambda found: -found[0])[:CONSIDERED]
    houses = np.array([each.polygon.centroid.coords[0] for each in renderer.world.buildings])

    def ahead(placement: CameraPlacement) -> int:
        found = _ahead(np.array([placement.x_m, placement.y_m]), placement.yaw_rad)(houses)
        return int(((found[:, 0] > 0) & (found[:, 0] < SIGHT_M[0]) & (abs(found[:, 1]) < SIGHT_M[1])).sum())

    both = [replace(placement, yaw_rad=placement.yaw_rad + turn) for _, placement, _ in ranked for turn in (0, math.pi)]
    return max(both, key=ahead)


def drive(renderer: GalleryRenderer) -> CameraPlacement:
    """A moving hatchback with traffic before it and a damaged road right ahead."""
    best = max(_drives(renderer), key=lambda found: found[0])
    return best[1]


def _times(renderer: GalleryRenderer) -> list[float]:
    return [round(time_s, 1) for time_s in np.linspace(20.0, renderer.recording.duration_s - 20.0, TIMES).tolist()]


def _placements(renderer: GalleryRenderer) -> Iterator[tuple[float, CameraPlacement, Defect]]:
    defects = np.array([[defect.centre.x, defect.centre.y] for defect in renderer.world.defects])
    broken = [index for index, defect in enumerate(renderer.world.defects) if defect.severity != "low"]
    for time_s in _times(renderer):
        poses = renderer.trace.agents_at(time_s)
        agents = np.stack([poses["x_m"], poses["y_m"]], axis=1)
        for index in broken[::2]:
            near = np.linalg.norm(agents - defects[index], axis=1)
            damage = int((np.linalg.norm(defects - defects[index], axis=1) < 4.0).sum())
            walking = poses["is_pedestrian"] & (near < 8.0)
            vehicles = int((~poses["is_pedestrian"] & (near < 8.0)).sum())
            agents_worth = 2.0 * vehicles + min(int(walking.sum()), MOST_PEDESTRIANS)
            score = agents_worth + min(damage, MOST_DEFECTS) - 6.0 * float((near < 2.5).sum())
            place = defects[index].tolist()
            defect = renderer.world.defects[index]
            yield score, CameraPlacement(place[0], place[1], _street_yaw(renderer, defect), time_s), defect


def _street_yaw(renderer: GalleryRenderer, defect: Defect) -> float:
    line = renderer.world.segment(defect.segment).centre_line
    dx, dy = direction_at(line, line.project(defect.centre))
    return math.atan2(dy, dx)


def _drives(renderer: GalleryRenderer) -> Iterator[tuple[float, CameraPlacement]]:
    is_ours = np.array([kind == "hatchback" for kind in renderer.recording.agents.kind])
    defects = np.array([[defect.centre.x, defect.centre.y] for defect in renderer.world.defects])
    area = np.array([defect.area_m2 for defect in renderer.world.defects])
    for time_s in _times(renderer):
        poses = renderer.trace.agents_at(time_s)
        xy = np.stack([poses["x_m"], poses["y_m"]], axis=1)
        speed = np.hypot(poses["east_mps"], poses["north_mps"])
        for row in np.flatnonzero(is_ours[poses["agent"]] & (speed > 2.0)).tolist():
            yaw = float(poses["yaw_rad"][row])
            ahead = _ahead(xy[row], yaw)
            others, damage = ahead(xy), ahead(defects)
            free = not bool(((others[:, 0] > 0.5) & (others[:, 0] < 11.0) & (abs(others[:, 1]) < 2.5)).any())
            seen = (others[:, 0] > 11.0) & (others[:, 0] < 40.0) & (abs(others[:, 1]) < 9.0)
            near = (damage[:, 0] > 3.5) & (damage[:, 0] < 10.0) & (abs(damage[:, 1]) < 2.0)
            score = min(float(area[near].sum()), 6.0) + min(int(seen.sum()), 8) - (0 if free else 20)
            yield score, CameraPlacement(float(xy[row, 0]), float(xy[row, 1]), yaw, time_s, int(poses["agent"][row]))


def _ahead(origin: np.ndarray, yaw_rad: float) -> Callable[[np.ndarray], np.ndarray]:
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]])
    return lambda points: np.asarray((points - origin) @ turn)


def _is_sunny(renderer: GalleryRenderer, defect: Defect) -> bool:
    """Whether it is in the morning's sun: no shadow of a house or tree, and no crown above it."""
    steep = math.tan(math.radians(MORNING.sun_elevation_deg))
    east, north = MORNING.to_sun[:2] / float(np.linalg.norm(MORNING.to_sun[:2]))

    def shades(shape: Polygon, height_m: float) -> bool:
        x, y = defect.centre.x, defect.centre.y
        reach = height_m / steep
        return bool(shape.distance(LineString([(x, y), (x + east * reach, y + north * reach)])) < 2.0)

    return not any(shades(building.polygon, building.height_m) for building in renderer.world.buildings) and not any(
        shades(item.position.buffer(item.radius_m), item.height_m) for item in renderer.world.furniture
    )
