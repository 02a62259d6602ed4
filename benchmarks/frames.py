"""Frames as datasets need them: a UAV's nadir picture of a street under high traffic, and a car's view along it."""

import math
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.measure import Kind, Line, median_s
from pavetwin.mission.replay import Replay
from pavetwin.render.adapter import find_adapter
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.view import View, look, nadir
from pavetwin.uav import find_camera
from pavetwin.world.model import World

PICTURE_TARGET_S, LABELLED_TARGET_S = 0.080, 0.120
SIZE_PX = (640, 640)
ALTITUDE_M, CAR_CAMERA_M = 10.0, 1.3
TIME_S, SEED = 300.0, 1
NEAR_M = 60.0


def lines(world: World, replay: Replay, runs: int) -> Iterator[Line]:
    """With the tiles made and uploaded; and what a tile takes."""
    adapter = find_adapter()
    scene = Scene(world, seed=SEED)
    renderer, camera, light = Renderer(scene), find_camera("phantom4pro"), Light(40.0, 140.0)
    x, y, yaw = _busiest(replay)
    instances = scene.agents(replay.recording, TIME_S, near=(x, y, NEAR_M))
    above = nadir(camera, (x, y, ALTITUDE_M), yaw_rad=yaw, size_px=SIZE_PX, velocity_mps=(3.0, 4.0, 0.0))
    behind = np.array([x, y]) - 9.0 * np.array([math.cos(yaw), math.sin(yaw)])
    along = look(
        (*behind, CAR_CAMERA_M), yaw_rad=yaw, pitch_rad=-0.12, size_px=SIZE_PX, vertical_fov_rad=math.radians(50)
    )

    def shoot(view: View, *, labels: bool) -> None:
        renderer.frame(view, light=light, camera=camera, instances=instances, labels=labels, depth=labels)

    begun = time.perf_counter()
    shoot(above, labels=True)
    first_s = time.perf_counter() - begun
    note = f"{SIZE_PX[0]} × {SIZE_PX[1]} px, {ALTITUDE_M:g} m, {len(instances)} agents near, shadows; {adapter}"
    still = View(above.position, above.rotation, above.size_px, above.focal_px)
    yield Line(
        "a UAV's frame", median_s(lambda: shoot(still, labels=False), runs), Kind.SECONDS, PICTURE_TARGET_S, note=note
    )
    note = "with labels, depth, what each thing would cover alone, and 5 m/s"
    yield Line(
        "the same with its labels",
        median_s(lambda: shoot(above, labels=True), runs),
        Kind.SECONDS,
        LABELLED_TARGET_S,
        note=note,
    )
    shoot(along, labels=True)
    yield Line("a car's frame with its labels", median_s(lambda: shoot(along, labels=True), runs), Kind.SECONDS)
    yield Line("the first frame of a place", first_s, Kind.SECONDS, note="tiles made and uploaded; one run")
    yield Line("what a renderer holds on its device", renderer.gpu.held_bytes / 2**20, Kind.MEBIBYTES)


def _busiest(replay: Replay) -> tuple[float, float, float]:
    """East, north and heading of the vehicle with the most others within 12 m."""
    poses = replay.trace().agents_at(TIME_S)
    at = np.stack([poses["x_m"], poses["y_m"]], axis=1)
    drives = np.flatnonzero(~poses["is_pedestrian"])
    crowd = (np.linalg.norm(at[drives, None] - at[None], axis=2) < 12.0).sum(axis=1)
    row = int(drives[int(crowd.argmax())])
    return float(poses["x_m"][row]), float(poses["y_m"][row]), float(poses["yaw_rad"][row])
