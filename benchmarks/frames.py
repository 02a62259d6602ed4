"""Frames as datasets need them: a UAV's nadir images over streets with high traffic, also over the most crowded place
of all, and a car's view along a street there; and how much longer they take with parked vehicles."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.measure import Kind, Line, Size, median_s
from pavetwin.config import Conditions
from pavetwin.config.mission import ParkingSettings
from pavetwin.mission.replay import Replay
from pavetwin.render.adapter import find_adapter
from pavetwin.render.nearby import FAR_M
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import TILE_M, Instance
from pavetwin.scene.view import View, look, nadir
from pavetwin.traffic.parked import parked_vehicles
from pavetwin.uav import find_camera
from pavetwin.world.model import World
from pavetwin.world.parking import StreetSide
from pavetwin.world.segments import direction_at, point_at

PICTURE_TARGET_S, LABELLED_TARGET_S = 0.080, 0.050
TILE_TARGET_S = 0.3
PARKED_TARGET = 1.25
"""A street that is parked full at both kerbs takes no longer than this ratio to the same street empty."""
ALTITUDE_M, CAR_CAMERA_M = 10.0, 1.3
TIME_S, SEED = 300.0, 1
NEAR_M = 60.0


def lines(world: World, replay: Replay, size: Size) -> Iterator[Line]:
    """With the tiles made and uploaded; and what a tile takes."""
    adapter, runs, size_px = find_adapter(), size.runs, size.frame_px
    scene = Scene(replace(world, content_hash=""), seed=SEED)  # so that its tiles are made
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
    yield from _beside_parked_vehicles(scene, renderer, size)
    yield Line("the first frame of a place", first_s, Kind.SECONDS, note="tiles made and uploaded; one run")
    yield from _tiles(world, size)
    yield Line("what a renderer holds on its device", renderer.gpu.held_bytes / 2**20, Kind.MEBIBYTES)


def _tiles(world: World, size: Size) -> Iterator[Line]:
    """Processor time of a tile on a street: its ground's maps, and its meshes and objects; the least of the runs, the
    median over the places."""
    scene = Scene(replace(world, content_hash=""), seed=SEED, tiles_kept=0)
    keys = [
        (int(place[0] // TILE_M), int(place[1] // TILE_M)) for place, _ in _along_streets(world, max(2, size.places))
    ]
    note, parts = f"processor time, without defects, median of {len(keys)} places", list[float]()
    for what, make in (("maps of a ground tile", scene.maps), ("meshes and objects of a tile", scene.tile)):
        make(keys[0])
        times = [min(_processor_s(partial(make, key)) for _ in range(size.runs)) for key in keys]
        parts.append(float(np.median(times)))
        yield Line(what, parts[-1], Kind.SECONDS, note=note)
    yield Line("a new tile of ground", sum(parts), Kind.SECONDS, TILE_TARGET_S, note="both")
    kept, times = Scene(world, seed=SEED, tiles_kept=0), list[float]()
    for key in keys:
        kept.maps(key), kept.tile(key)
        times.append(min(_processor_s(lambda: (kept.maps(key), kept.tile(key))) for _ in range(size.runs)))  # noqa: B023
    yield Line("the same from the cache", float(np.median(times)), Kind.SECONDS, note=note)


def _processor_s(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _beside_parked_vehicles(scene: Scene, renderer: Renderer, size: Size) -> Iterator[Line]:
    """How much longer frames take where every place is taken: the median over pairs of a frame with and one without."""
    world, camera, light = scene.world, find_camera("phantom4pro"), Light(40.0, 140.0)
    sides = Counter((place.segment, place.side) for place in world.parking)
    segment = max(world.segments, key=lambda each: min(sides[each.id, side] for side in StreetSide))
    stands = parked_vehicles(world, ParkingSettings(enabled=True, occupancy=1.0), Conditions(), SEED)

    def ratio(view: View, *, labels: bool) -> float:
        near = (float(view.position[0]), float(view.position[1]), FAR_M)
        empty = scene.agents(None, 0.0, near)
        full = (*empty, *scene.parked(stands, near))

        def taken_s(seen: tuple[Instance, ...]) -> float:
            begun = time.perf_counter()
            renderer.frame(view, light=light, camera=camera, instances=seen, labels=labels, depth=labels)
            return time.perf_counter() - begun

        taken_s(empty), taken_s(full)
        return float(np.median([taken_s(full) / taken_s(empty) for _ in range(size.runs)]))

    above, along = [], []
    for share in (np.arange(size.places) + 1) / (size.places + 1):
        at = float(share) * segment.centre_line.length
        (x, y), (dx, dy) = point_at(segment.centre_line, at), direction_at(segment.centre_line, at)
        yaw = math.atan2(dy, dx)
        above.append(nadir(camera, (x, y, ALTITUDE_M), yaw_rad=yaw, size_px=size.frame_px))
        along.append(
            look(
                (x, y, CAR_CAMERA_M),
                yaw_rad=yaw,
                pitch_rad=-0.12,
                size_px=size.frame_px,
                vertical_fov_rad=math.radians(50),
            )
        )
    cars = sum(sides[segment.id, side] for side in StreetSide)
    for what, views, labels in (
        ("a UAV's frame of a street parked full, to it empty", above, False),
        ("the same with its labels", above, True),
        ("a car's frame with labels there, to it empty", along, True),
    ):
        note = f"{cars} places along {segment.length_m:.0f} m, median of {len(views)} places"
        value = float(np.median([ratio(view, labels=labels) for view in views]))
        yield Line(what, value, Kind.RATIO, PARKED_TARGET, note=note)


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
