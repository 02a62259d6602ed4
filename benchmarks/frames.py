"""Frames as datasets need them: a UAV's nadir pictures over streets with high traffic, also over the most crowded place
of all, and a car's view along a street there."""

import math
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.measure import Kind, Line, Size, median_s
from pavetwin.mission.replay import Replay
from pavetwin.render.adapter import find_adapter
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import Light
from pavetwin.scene.model import Instance
from pavetwin.scene.scene import Scene
from pavetwin.scene.view import View, look, nadir
from pavetwin.uav import find_camera
from pavetwin.world.model import World
from pavetwin.world.segments import direction_at, point_at

PICTURE_TARGET_S, LABELLED_TARGET_S = 0.080, 0.120
ALTITUDE_M, CAR_CAMERA_M = 10.0, 1.3
TIME_S, SEED = 300.0, 1
NEAR_M = 60.0


def lines(world: World, replay: Replay, size: Size) -> Iterator[Line]:
    """With the tiles made and uploaded; and what a tile takes."""
    adapter, runs, size_px = find_adapter(), size.runs, size.frame_px
    scene = Scene(world, seed=SEED)
    renderer, camera, light = Renderer(scene), find_camera("phantom4pro"), Light(40.0, 140.0)
    x, y, yaw = _busiest(replay)
    instances = scene.agents(replay.recording, TIME_S, near=(x, y, NEAR_M))
    above = nadir(camera, (x, y, ALTITUDE_M), yaw_rad=yaw, size_px=size_px, velocity_mps=(3.0, 4.0, 0.0))
    behind = np.array([x, y]) - 9.0 * np.array([math.cos(yaw), math.sin(yaw)])
    along = look(
        (*behind, CAR_CAMERA_M), yaw_rad=yaw, pitch_rad=-0.12, size_px=size_px, vertical_fov_rad=math.radians(50)
    )

    def shoot(view: View, seen: tuple[Instance, ...], *, labels: bool, defect_free: bool = False) -> None:
        renderer.frame(
            view, light=light, camera=camera, instances=seen, labels=labels, depth=labels, defect_free=defect_free
        )

    begun = time.perf_counter()
    shoot(above, instances, labels=True)
    first_s = time.perf_counter() - begun
    plain, labelled, doubled = [], [], []
    for place, at_s in _along_streets(world, size.places):
        near = scene.agents(replay.recording, at_s, near=(*place[:2], NEAR_M))
        view = nadir(camera, (*place[:2], ALTITUDE_M), yaw_rad=place[2], size_px=size_px, velocity_mps=(3.0, 4.0, 0.0))
        shoot(view, near, labels=True)
        plain.append(median_s(lambda: shoot(_still(view), near, labels=False), runs))  # noqa: B023
        labelled.append(median_s(lambda: shoot(view, near, labels=True), runs))  # noqa: B023
        doubled.append(median_s(lambda: shoot(view, near, labels=True, defect_free=True), runs))  # noqa: B023
    note = f"{size_px[0]} × {size_px[1]} px, {ALTITUDE_M:g} m, shadows, median of {size.places} places; {adapter}"
    yield Line("a UAV's frame over a street", float(np.median(plain)), Kind.SECONDS, PICTURE_TARGET_S, note=note)
    note = "with labels, depth, amodal pixels, and 5 m/s"
    yield Line("the same with its labels", float(np.median(labelled)), Kind.SECONDS, LABELLED_TARGET_S, note=note)
    note = "developed twice, for the contrast of defects in datasets"
    yield Line("the same, with the defect-free image", float(np.median(doubled)), Kind.SECONDS, note=note)
    crowded_s = median_s(lambda: shoot(_still(above), instances, labels=False), runs)
    note = f"{len(instances)} vehicles and people near"
    yield Line("a UAV's frame over the most crowded place", crowded_s, Kind.SECONDS, note=note)
    crowded_s = median_s(lambda: shoot(above, instances, labels=True), runs)
    yield Line("the same with its labels", crowded_s, Kind.SECONDS)
    shoot(along, instances, labels=True)
    along_s = median_s(lambda: shoot(along, instances, labels=True), runs)
    yield Line("a car's frame with its labels", along_s, Kind.SECONDS, note="along the street there")
    yield Line("the first frame of a place", first_s, Kind.SECONDS, note="tiles made and uploaded; one run")
    yield Line("what a renderer holds on its device", renderer.gpu.held_bytes / 2**20, Kind.MEBIBYTES)


def _still(view: View) -> View:
    return View(view.position, view.rotation, view.size_px, view.focal_px)


def _along_streets(world: World, places: int) -> Iterator[tuple[tuple[float, float, float], float]]:
    """East, north and heading of the street, and a time of the recording."""
    ends = np.cumsum([segment.length_m for segment in world.segments])
    for number, station in enumerate(((np.arange(places) + 0.5) / places * ends[-1]).tolist()):
        row = int(np.searchsorted(ends, station))
        line = world.segments[row].centre_line
        along = line.length - (float(ends[row]) - station)
        (x, y), (dx, dy) = point_at(line, along), direction_at(line, along)
        yield (x, y, math.atan2(dy, dx)), TIME_S + 37.0 * number


def _busiest(replay: Replay) -> tuple[float, float, float]:
    """East, north and heading of the vehicle with the most others within 12 m."""
    poses = replay.trace().agents_at(TIME_S)
    at = np.stack([poses["x_m"], poses["y_m"]], axis=1)
    drives = np.flatnonzero(~poses["is_pedestrian"])
    neighbours = (np.linalg.norm(at[drives, None] - at[None], axis=2) < 12.0).sum(axis=1)
    row = int(drives[int(neighbours.argmax())])
    return float(poses["x_m"][row]), float(poses["y_m"][row]), float(poses["yaw_rad"][row])
