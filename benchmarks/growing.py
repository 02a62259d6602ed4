"""Time of a step as the city grows a hundredfold around the same camera."""

import itertools
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from benchmarks.measure import Kind, Line
from benchmarks.missions import Course
from pavetwin._core import Arrived, Ground, NavMesh, RecordingEnds, Trace
from pavetwin.defects import sample_points
from pavetwin.mission.environment import MissionEnvironment, new_flight
from pavetwin.navigation.navmesh import navmesh
from pavetwin.navigation.patterns import passes
from pavetwin.world.model import Surface
from pavetwin.world.solids import solids

TRAFFIC_S = 60.0
GAP_M = 50.0
TARGET = 1.5


def line(course: Course, runs: int, copies: int) -> Line:
    """The same 60 s of flight over the single town, and over it in the middle of `copies` × `copies` of it with their
    traffic."""
    town, city = (_copied(course, side) for side in (1, copies))
    _fly(course, *town)
    _fly(course, *city)
    ratios, step_s = [], []
    for _ in range(runs):
        in_town, in_city = _fly(course, *town), _fly(course, *city)
        ratios.append(in_city / in_town)
        step_s.append(in_city)
    note = f"{statistics.median(step_s) * 1e6:.2f} µs a step in the city of {copies * copies} towns"
    return Line(
        f"cost of a step in a city {copies * copies} × as large",
        statistics.median(ratios),
        Kind.RATIO,
        TARGET,
        note=note,
    )


def _fly(course: Course, environment: MissionEnvironment, trace: Trace) -> float:
    """Climbs, flies to the first segment and inspects it until the recording ends; seconds a time step."""
    flight = new_flight(environment, trace, course.settings)
    segment = environment.world.segments[course.targets[0]]
    lane = passes(segment, 8.0, course.settings.pattern)[0]
    start = (float(lane[0, 0]), float(lane[0, 1]))
    commands: tuple[Callable[[], None], ...] = (
        lambda: flight.climb_to(course.settings.altitude_m),
        lambda: flight.fly_to(start),
        lambda: flight.inspect(course.targets[0], lane),
    )
    begun = time.perf_counter()
    for command in commands:
        command()
        while not isinstance(event := flight.advance(), Arrived):
            if isinstance(event, RecordingEnds):
                break
    return (time.perf_counter() - begun) / max(flight.time_s / course.settings.time_step_s, 1)


def _copied(course: Course, side: int) -> tuple[MissionEnvironment, Trace]:
    """`side` × `side` copies of everything the kernel knows, the town itself in the middle and first in every list."""
    world, settings = course.environment.world, course.settings
    standing = solids(world)
    mesh = navmesh(world, settings.altitude_m, settings.uav.radius_m, standing)
    traffic = course.replay.recording.until(TRAFFIC_S).tracks.rows
    places = np.vstack([mesh.vertices(), standing.xy, np.column_stack([traffic.x, traffic.y])])
    pitch = np.ptp(places, axis=0) + GAP_M
    steps = sorted(
        ((i, j) for i in range(side) for j in range(side)),
        key=lambda ij: abs(ij[0] - side // 2) + abs(ij[1] - side // 2),
    )
    shifts = (np.array(steps) - steps[0]) * pitch
    rings = [_rings(segment.polygon) for segment in world.segments]
    defects = course.environment.defects
    index = {segment.id: number for number, segment in enumerate(world.segments)}
    count = len(shifts)
    ground = Ground(
        NavMesh.from_polygons(
            _shifted(mesh.vertices(), shifts),
            _offsets(mesh.offsets(), count),
            (mesh.corners()[None] + (np.arange(count) * len(mesh.vertices()))[:, None]).astype(np.uint32).ravel(),
        ),
        cell_m=settings.visibility.cell_m,
        surface_rings=[[ring + shift for ring in surface] for shift in shifts for surface in rings],
        solid_offsets=_offsets(standing.offsets, count),
        solid_xy=_shifted(standing.xy, shifts),
        solid_z0=np.tile(standing.z0, count),
        solid_z1=np.tile(standing.z1, count),
        solid_is_parked=np.zeros(count * len(standing.z1), dtype=bool),
        # Defects are looked up by segment: those of the other copies would be copies of the list, nothing more.
        defect_centres=np.array([(d.centre.x, d.centre.y) for d in defects], dtype=np.float64).reshape(-1, 2),
        defect_segments=np.array([index[defect.segment] for defect in defects], dtype=np.uint32),
        defect_points=lambda number: sample_points(defects[number]),
    )
    return replace(course.environment, ground=ground), _crowd(course, shifts)


def _crowd(course: Course, shifts: npt.NDArray[np.float64]) -> Trace:
    """The recording with a copy of every agent in every copy of the town."""
    recording = course.replay.recording.until(TRAFFIC_S)
    traffic, bodies = recording.tracks.rows, recording.agents
    agents, count = len(bodies), len(shifts)
    offsets = traffic.step_offsets.astype(np.int64)
    pairs = list(itertools.pairwise(offsets))
    # Rows stay sorted by step, and within a step by agent: one copy after the other.
    rows = np.concatenate([np.tile(np.arange(a, b), count) for a, b in pairs])
    copy = np.concatenate([np.repeat(np.arange(count), b - a) for a, b in pairs])
    return Trace(
        step_s=recording.step_s,
        step_offsets=(offsets * count).astype(np.uint32),
        agent=(traffic.agent[rows] + copy * agents).astype(np.uint32),
        x_m=(traffic.x[rows] + shifts[copy, 0]).astype(np.float32),
        y_m=(traffic.y[rows] + shifts[copy, 1]).astype(np.float32),
        yaw_rad=traffic.yaw_rad[rows],
        speed_mps=traffic.speed_mps[rows],
        length_m=np.tile(bodies.length_m, count),
        width_m=np.tile(bodies.width_m, count),
        height_m=np.tile(bodies.height_m, count),
        base_m=np.zeros(agents * count, dtype=np.float32),
        is_pedestrian=np.tile(bodies.is_pedestrian, count),
    )


def _shifted(points: npt.NDArray[np.float64], shifts: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return (points[None] + shifts[:, None]).reshape(-1, 2)


def _offsets(offsets: npt.NDArray[np.int64] | npt.NDArray[np.uint32], count: int) -> npt.NDArray[np.uint32]:
    last = int(offsets[-1])
    tiled = (offsets[:-1].astype(np.int64)[None] + (np.arange(count) * last)[:, None]).ravel()
    return np.append(tiled, last * count).astype(np.uint32)


def _rings(surface: Surface) -> list[npt.NDArray[np.float64]]:
    parts = shapely.get_parts(surface)
    return [shapely.get_coordinates(ring) for part in parts for ring in (part.exterior, *part.interiors)]
