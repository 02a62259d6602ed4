"""Tiny worlds and hand-written traffic, as values: no SUMO, no files. A scene is a world, its traffic and a story.

The usual street runs east along the x axis from 0 to 60 m, 7 m wide; its left (north) half has y > 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import shapely
from shapely import LineString, Point, Polygon

from pavetwin._core import Trace
from pavetwin.config import MissionSettings, load_settings
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.fly import fly_over
from pavetwin.mission.result import MissionResult
from pavetwin.policies import Policy
from pavetwin.world.model import (
    Building,
    Defect,
    Furniture,
    GeoReference,
    Junction,
    Segment,
    Severity,
    Street,
    World,
)

STEP_S = 0.5

# What moves.


@dataclass(frozen=True)
class Size:
    length_m: float
    width_m: float
    height_m: float
    is_pedestrian: bool = False


CAR = Size(4.5, 1.8, 1.5)
TRUCK = Size(9.0, 2.5, 3.5)
PERSON = Size(0.5, 0.5, 1.75, is_pedestrian=True)

Pose = tuple[float, float, float, float]
"""East, north, yaw, speed."""


@dataclass(frozen=True)
class Mover:
    """One agent: its size, and where it is at a time, if it is there."""

    size: Size
    pose: Callable[[float], Pose | None]


def parked(x: float, y: float, size: Size = CAR, *, until_s: float = np.inf, yaw_rad: float = 0.0) -> Mover:
    """Stands from the beginning until a time, and is gone then."""
    return Mover(size, lambda t: (x, y, yaw_rad, 0.0) if t < until_s else None)


def passing(x: float, y: float, east_mps: float, size: Size = CAR, *, from_s: float = 0.0) -> Mover:
    """Is at (x, y) at `from_s`, and drives along x at an even speed before and after."""
    yaw = 0.0 if east_mps >= 0 else np.pi
    return Mover(size, lambda t: (x + east_mps * (t - from_s), y, yaw, abs(east_mps)))


@dataclass
class TinyTraffic:
    """Hand-written agents behind the mission's protocol. It is as long as asked, with the same beginning always."""

    movers: Sequence[Mover] = ()
    duration_s: float = 600.0
    extended: list[float] = field(default_factory=list)
    """Durations that it was asked for, in s."""
    _trace: Trace | None = field(default=None, repr=False)

    def trace(self) -> Trace:
        if self._trace is None:
            self._trace = trace_of(self.movers, self.duration_s)
        return self._trace

    def extend(self, needed_s: float) -> Trace:
        self.extended.append(needed_s)
        self.duration_s = max(self.duration_s, needed_s) * 2
        self._trace = None
        return self.trace()


def trace_of(movers: Sequence[Mover], duration_s: float) -> Trace:
    """The recording of some agents, a step every half second."""
    rows: list[tuple[int, Pose]] = []
    offsets = [0]
    for step in range(round(duration_s / STEP_S) + 1):
        poses = ((index, mover.pose(step * STEP_S)) for index, mover in enumerate(movers))
        rows += [(index, pose) for index, pose in poses if pose is not None]
        offsets.append(len(rows))
    columns = np.array([pose for _, pose in rows], dtype=np.float32).reshape(-1, 4)
    sizes = [mover.size for mover in movers]
    return Trace(
        step_s=STEP_S,
        step_offsets=np.array(offsets, dtype=np.uint32),
        agent=np.array([index for index, _ in rows], dtype=np.uint32),
        x_m=np.ascontiguousarray(columns[:, 0]),
        y_m=np.ascontiguousarray(columns[:, 1]),
        yaw_rad=np.ascontiguousarray(columns[:, 2]),
        speed_mps=np.ascontiguousarray(columns[:, 3]),
        length_m=np.array([size.length_m for size in sizes], dtype=np.float32),
        width_m=np.array([size.width_m for size in sizes], dtype=np.float32),
        height_m=np.array([size.height_m for size in sizes], dtype=np.float32),
        base_m=np.zeros(len(sizes), dtype=np.float32),
        is_pedestrian=np.array([size.is_pedestrian for size in sizes], dtype=np.bool_),
    )


# What stands still.


def street(name: str, *corners: tuple[float, float], width_m: float = 7.0) -> Segment:
    """A street along a line, with square ends."""
    line = LineString(corners)
    surface = shapely.buffer(line, width_m / 2, cap_style="flat", join_style="mitre")
    assert isinstance(surface, Polygon)
    return Segment(name, name, (name,), line, surface, width_m, 2)


def defect(number: int, x: float, y: float, segment: str = "street", side_m: float = 0.4) -> Defect:
    """A square pothole."""
    half = side_m / 2
    shape = shapely.box(x - half, y - half, x + half, y + half)
    assert isinstance(shape, Polygon)
    return Defect(
        id=number,
        segment=segment,
        kind="pothole",
        centre=Point(x, y),
        polygon=shape,
        seed=number,
        yaw_rad=0.0,
        severity=Severity.MEDIUM,
        width_m=side_m,
        depth_m=0.04,
        length_m=0.0,
        volume_m3=0.6 * 0.04 * side_m**2,
    )


def world(
    segments: Sequence[Segment],
    defects: Sequence[Defect] = (),
    *,
    junctions: Sequence[Junction] = (),
    buildings: Sequence[Building] = (),
    furniture: Sequence[Furniture] = (),
    base: tuple[float, float] = (-2.0, 0.0),
) -> World:
    return World(
        name="tiny",
        georeference=GeoReference(32632, 500000.0, 5000000.0),
        left_hand=False,
        streets=tuple(Street(s.street, s.street, "", s.edges, "", "", s.centre_line) for s in segments),
        segments=tuple(segments),
        lanes=(),
        connections=(),
        junctions=tuple(junctions),
        crossings=(),
        buildings=tuple(buildings),
        furniture=tuple(furniture),
        parks=(),
        defects=tuple(defects),
        base=Point(base),
    )


def straight(
    *places: tuple[float, float],
    length_m: float = 60.0,
    width_m: float = 7.0,
    buildings: Sequence[Building] = (),
) -> World:
    """The usual street, with a pothole at each place."""
    return world(
        [street("street", (0, 0), (length_m, 0), width_m=width_m)],
        [defect(number, x, y) for number, (x, y) in enumerate(places)],
        buildings=buildings,
    )


def block(name: str, x0: float, y0: float, x1: float, y1: float, height_m: float) -> Building:
    """A box of a building."""
    shape = shapely.box(x0, y0, x1, y1)
    assert isinstance(shape, Polygon)
    return Building(name, shape, height_m)


def bent() -> World:
    """A street that bends twice, a junction at its end, and a side street off it: every kind of turn in 150 m."""
    corner = shapely.box(96.5, 16.5, 103.5, 23.5)
    assert isinstance(corner, Polygon)
    return world(
        [
            street("bent", (0, 0), (40, 0), (70, 20), (96.5, 20)),
            street("side", (100, 23.5), (100, 70), width_m=5.0),
            street("ahead", (103.5, 20), (150, 10), width_m=9.0),
        ],
        [
            defect(0, 20, 1, "bent"),
            defect(1, 55, 10, "bent"),
            defect(2, 100, 50, "side"),
            defect(3, 120, 17, "ahead"),
        ],
        junctions=[Junction("corner", "priority", corner)],
    )


# Scenes: something stands or moves where a defect lies, on the usual street, or on one of 4 m that a car fills.


@dataclass(frozen=True)
class Scene:
    """A world and its traffic, with the settings of its story."""

    world: World
    movers: tuple[Mover, ...] = ()
    altitude_m: float = 6.0

    def settings(self, *overrides: str, preset: str = "default", **given: Any) -> MissionSettings:
        """The preset at the scene's altitude, with the camera that the stories are written for, and the sensor
        that misses nothing, unless others are asked for."""
        usual = [f"altitude_m={self.altitude_m}", "sensing.sensor=ideal", "camera.model=paper"]
        return load_settings(preset, [*usual, *overrides], **given)

    def traffic(self, duration_s: float = 600.0) -> TinyTraffic:
        return TinyTraffic(self.movers, duration_s)

    def environment(self, settings: MissionSettings | None = None) -> MissionEnvironment:
        return prepare(self.world, settings or self.settings())

    def emptied(self) -> "Scene":
        """The same without traffic."""
        return replace(self, movers=())

    def fly(self, policy: str | Policy, *overrides: str, preset: str = "default", seed: int = 0) -> MissionResult:
        """Every segment in turn, under a policy."""
        settings = self.settings(*overrides, preset=preset)
        targets = range(len(self.world.segments))
        return fly_over(self.environment(settings), self.traffic(), settings, list(targets), policy, seed=seed)


def empty_street(*places: tuple[float, float]) -> Scene:
    return Scene(straight(*places))


def parked_car_over_defect() -> Scene:
    """A car that never leaves stands on defect 0."""
    return Scene(straight((30, 0), width_m=4.0), (parked(30, 0),))


def car_that_leaves(at_s: float = 40.0) -> Scene:
    """A car stands on defect 0 and leaves, long after the UAV first came by."""
    return Scene(straight((30, 0), width_m=4.0), (parked(30, 0, until_s=at_s),))


def truck_beside_defects() -> Scene:
    """A tall truck stands between the route and the defects 0 to 6, which lie behind it along the northern edge."""
    places = [(27.0 + metre, 3.2) for metre in range(7)]
    return Scene(straight(*places), (parked(30, 1.75, TRUCK),), altitude_m=10.0)


def queue_at_light(leaves_at_s: float = np.inf) -> Scene:
    """Seven cars and a truck wait in a queue, each over one defect."""
    places = [(10.0 + 6.0 * k, 0.0) for k in range(7)]
    cars = [parked(x, y, until_s=leaves_at_s) for x, y in places]
    return Scene(straight(*places, width_m=4.0), (*cars, parked(54, 0, TRUCK, until_s=leaves_at_s)))


def lively_street() -> Scene:
    """Cars pass both ways, one is parked, a truck crawls and people walk: something of everything."""
    people = [passing(10 + 9 * k, 3.0 - k, 1.2 - 0.6 * k, PERSON) for k in range(4)]
    cars = [passing(-60 - 25 * k, -1.75, 8.0, CAR) for k in range(6)]
    others = [passing(200 + 30 * k, 1.75, -6.0, TRUCK if k == 1 else CAR) for k in range(6)]
    crawler = passing(-20, -1.75, 1.0, TRUCK)
    places = [(6.0 + 6.0 * k, (-1.75, 1.75, 0.0)[k % 3]) for k in range(9)]
    return Scene(straight(*places), (*people, *cars, *others, crawler, parked(42, 1.75)))


SCENES: dict[str, Callable[[], Scene]] = {
    "empty_street": lambda: empty_street((30, 0)),
    "parked_car_over_defect": parked_car_over_defect,
    "car_that_leaves": car_that_leaves,
    "truck_beside_defects": truck_beside_defects,
    "queue_at_light": queue_at_light,
    "queue_that_leaves": lambda: queue_at_light(leaves_at_s=22.0),
    "lively_street": lively_street,
}


@cache
def result(scene: str, policy: str, *overrides: str, preset: str = "default", seed: int = 0) -> MissionResult:
    """The mission of a named scene, flown once a test run."""
    return SCENES[scene]().fly(policy, *overrides, preset=preset, seed=seed)
