"""Manual drive over the environment and traffic of missions, with the rear camera of the survey car.

```python
drive = Drive(environment, traffic, settings, sensor, street="s0001")
while not drive.is_over:
    drive.step(Pedals(ahead=1.0))
```

The rear camera of `pavetwin.capture.platforms.car` looks straight down, so its view is judged like that of a UAV's
camera: the kernel finds the cells of the road and the shares of the defects that nothing hides, the mission's sensor
reports, and `DetectionLog` judges. Its whole image is the inspection window. The traffic is recorded: it does not
react, and drives through the car. The same pedals give the same drive: `drive_again`.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import hypot
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from shapely import STRtree

from pavetwin._core import Ground, NadirCamera, Trace, Viewpoint
from pavetwin.capture.platforms.car import REAR
from pavetwin.config import MissionSettings
from pavetwin.driving.car import CarLimits, CarState, Pedals, moved, speed_after, steering_after
from pavetwin.driving.road import ASIDE, DrivableRoad, body
from pavetwin.errors import PaveTwinError
from pavetwin.mission.by_hand import STEP_S, InputChange, input_by_step, surface_below
from pavetwin.mission.detections import DetectionLog
from pavetwin.mission.environment import MissionEnvironment, shutter_s
from pavetwin.mission.inspected_defects import HIDDEN, MissReason
from pavetwin.mission.mission import Traffic
from pavetwin.sensing import Frame, Outcome, Sensor

if TYPE_CHECKING:
    from pavetwin._core import DefectShares


@dataclass
class DefectLooks:
    """Captures of a defect's centre."""

    captures: int = 0
    visible: float = 0.0
    """The largest visible share of its area."""
    time_s: float | None = None
    """Time of the first capture with that share."""
    _hidden: dict[MissReason, float] = field(default_factory=lambda: dict.fromkeys(HIDDEN, 0.0))

    def add(self, shares: "DefectShares", time_s: float) -> None:
        """Add a capture."""
        self.captures += 1
        if self.time_s is None or shares["visible"] > self.visible:
            self.visible, self.time_s = shares["visible"], time_s
        for reason, column in HIDDEN.items():
            self._hidden[reason] += shares[column]  # type: ignore[literal-required]

    def hidden_by(self) -> dict[MissReason, float]:
        """Hidden shares of its area by reason, means over the captures."""
        return {reason: share / self.captures for reason, share in self._hidden.items() if share}

    def reason(self, least_visible: float) -> MissReason:
        """The reason why it was missed.

        Args:
            least_visible: least visible share for a sensor to report it.
        """
        if not self.captures:
            return MissReason.OUTSIDE_SWATH
        if self.visible >= least_visible:
            return MissReason.NOT_RECOGNISED
        hidden = self.hidden_by()
        return max(hidden, key=lambda reason: hidden[reason])


UNIT_M: Final = 0.001
"""Resolution at which places of cells are compared, far below a cell's side."""


class SeenCells:
    """Cells of each segment that were visible in at least one capture."""

    def __init__(self, ground: Ground, camera: NadirCamera, height_m: float) -> None:
        """Args:
        camera: a camera that looks straight down; cells in its inspection window count.
        height_m: height of the camera above the ground.
        """
        self._ground, self._camera, self._height_m = ground, camera, height_m
        self._cells: dict[int, set[tuple[int, int]]] = {}
        self._counts: dict[int, int] = {}

    @property
    def targets(self) -> list[int]:
        """Indices of the captured segments, in the order of their first capture."""
        return list(self._cells)

    def share(self, segment: int) -> float:
        """Share of a segment's cells that were seen."""
        if segment not in self._counts:
            nowhere, north = np.zeros((0, 2)), np.zeros(0)
            self._counts[segment] = self._ground.reach(segment, self._camera, self._height_m, nowhere, north)["cells"]
        return len(self._cells.get(segment, ())) / max(1, self._counts[segment])

    def look(
        self, segments: list[int], trace: Trace, time_s: float, viewpoint: Viewpoint, *, counts: bool
    ) -> float | None:
        """Look at segments.

        Args:
            counts: the look is a capture, so that visible cells count as seen.

        Returns:
            o, the visible share of the cells in the window that no static object hides; None without any.
        """
        candidates = visible = 0
        for segment in segments:
            look = self._ground.observe(segment, trace, time_s, self._camera, viewpoint)
            candidates += len(look["candidates"])
            visible += len(look["visible"])
            if counts and len(look["candidates"]):
                cells = np.round(look["visible"] / UNIT_M).astype(np.int64)
                self._cells.setdefault(segment, set()).update(map(tuple, cells.tolist()))
        return visible / candidates if candidates else None


CAPTURE_EVERY_M: Final = 1.5
"""Distance between two captures: half an image's extent along the road, so that each place is in two images."""


@dataclass(frozen=True, slots=True)
class Capture:
    """One image of the rear camera."""

    time_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    segment: int
    visibility: float | None
    """o; None if static objects hide all road in the image."""


@dataclass(frozen=True, slots=True)
class DrivenSegment:
    """Results of a drive for a segment."""

    segment: str
    street: str
    length_m: float
    area_m2: float
    surface_coverage: float
    defects: int
    found: int
    false_alarms: int


class Drive:
    """One manual drive, in steps of `STEP_S`."""

    def __init__(
        self,
        environment: MissionEnvironment,
        traffic: Traffic,
        settings: MissionSettings,
        sensor: Sensor,
        *,
        street: str | None = None,
        limits: CarLimits | None = None,
    ) -> None:
        """Args:
            street: id of the segment on which it begins; by default near the place of take-off.

        Raises:
            PaveTwinError: the sensor looks at images, which a drive does not have, or no lane has room for a car.
        """
        if sensor.after_landing:
            raise PaveTwinError(
                f"`sensor`: '{sensor.name}' looks at images after the drive; choose one that answers at once, "
                "such as calibrated."
            )
        self.environment, self.traffic, self.settings, self.sensor = environment, traffic, settings, sensor
        self.limits = limits or CarLimits()
        self.road = DrivableRoad(environment.world, environment.parked, self.limits)
        self.state = self.road.start(street)
        self.changes: list[InputChange[Pedals]] = []
        self.states: list[CarState] = [self.state]
        """State at each step, from the start on."""
        self.stops: list[bool] = [False]
        """For each step, True if the car was blocked."""
        self.looks: list[float | None] = [None]
        """o at each step."""
        self.captures: list[Capture] = []
        self.confirmed: dict[int, float] = {}
        """Time at which each defect was found [s], by its id."""
        self.looks_at: dict[int, DefectLooks] = {}
        """Captures of each captured defect, by its id."""
        self.distance_m, self.is_over, self.is_met = 0.0, False, False
        self.meetings = 0
        """Number of recorded road users that overlapped the car."""
        self.camera = NadirCamera(
            image_px=REAR.camera.image_px, vertical_fov_rad=REAR.camera.fov_rad, window_rows=1.0, window_columns=1.0
        )
        self.seen = SeenCells(environment.ground, self.camera, REAR.z_m)
        self.detections = DetectionLog(environment, sensor=sensor.name, other_classes=sensor.other_classes)
        self._pedals, self._trace = Pedals(), traffic.trace()
        self._surfaces = STRtree([segment.polygon for segment in environment.world.segments])
        self._attempts = Counter[int]()
        self._captured_m = 0.0
        self._met: frozenset[int] = frozenset()
        self._sun_deg = environment.sun_elevation_deg(settings.conditions)
        self.below: int | None = None
        """Segment in the middle of the image, or the previous one between segments; None before the first look."""

    @property
    def time_s(self) -> float:
        """Time since the start."""
        return (len(self.states) - 1) * STEP_S

    @property
    def is_blocked(self) -> bool:
        """True if an obstacle or the end of the road stopped the car in the last step."""
        return self.stops[-1]

    @property
    def camera_place(self) -> tuple[float, float]:
        """Place of the rear camera, world frame."""
        return self.state.place(REAR.x_m)

    def step(self, pedals: Pedals) -> list[int]:
        """Drive on for `STEP_S`, and return the defects found.

        Raises:
            PaveTwinError: the recording cannot be extended.
        """
        if self._pedals.ends:
            pedals = replace(pedals, ends=True)
        if pedals != self._pedals or not self.changes:
            self.changes.append(InputChange(len(self.states) - 1, pedals))
        self._pedals = pedals
        before, self.state = self.state, self._next(pedals)
        moved_m = hypot(self.state.x_m - before.x_m, self.state.y_m - before.y_m)
        self.distance_m += moved_m
        self._captured_m += moved_m
        self.states.append(self.state)
        if self._trace.duration_s <= self.time_s + STEP_S:
            self._trace = self.traffic.extend(self.time_s + STEP_S)
        self._meet()
        found = self._look()
        self.is_over = pedals.ends and self.state.speed_mps == 0.0
        return found

    def coverage(self) -> dict[str, float]:
        """Share of the surface seen so far, by segment, in the order in which the camera first saw them."""
        segments = self.environment.world.segments
        return {segments[target].id: self.seen.share(target) for target in self.seen.targets}

    def rows(self) -> list[DrivenSegment]:
        """Results for each segment."""
        segments, rows = self.environment.world.segments, []
        found = self.detections.all
        alarms = Counter(found.segment[found.outcome == Outcome.FALSE_ALARM].tolist())
        for target in self.seen.targets:
            segment = segments[target]
            defects = self.environment.defects_by_segment.get(segment.id, ())
            rows.append(
                DrivenSegment(
                    segment=segment.id,
                    street=segment.street_name,
                    length_m=segment.length_m,
                    area_m2=segment.area_m2,
                    surface_coverage=self.seen.share(target),
                    defects=len(defects),
                    found=sum(defect in self.confirmed for defect in defects),
                    false_alarms=alarms[target],
                )
            )
        return rows

    def _next(self, pedals: Pedals) -> CarState:
        """The state after a step. A kerb turns the wheels along it; if that does not suffice, the car stops."""
        state, limits = self.state, self.limits
        self.stops.append(False)
        speed_mps = speed_after(state.speed_mps, pedals, limits, STEP_S)
        wanted_rad = pedals.left * limits.steering_rad
        turned = steering_after(replace(state, speed_mps=speed_mps), wanted_rad, limits, STEP_S)
        if speed_mps == 0.0 and state.speed_mps == 0.0:
            return replace(state, steering_rad=turned)
        most_rad = limits.steering_at(speed_mps)
        for aside in ASIDE:
            steering = min(max(turned + aside * limits.steering_rad, -most_rad), most_rad)
            next_state = moved(state, speed_mps, steering, limits, STEP_S)
            if self.road.holds(next_state):
                return next_state
        self.stops[-1] = True
        return replace(state, speed_mps=0.0, steering_rad=turned)

    def _meet(self) -> None:
        """Count the recorded road users that overlap the car."""
        state, reach_m = self.state, 20.0
        there = self._trace.agents_near(state.x_m, state.y_m, reach_m, self.time_s)
        own, met = body(state), set()
        for row in np.flatnonzero(np.hypot(there["x_m"] - state.x_m, there["y_m"] - state.y_m) < reach_m):
            x, y, yaw = (float(there[name][row]) for name in ("x_m", "y_m", "yaw_rad"))
            length, width = (float(there[name][row]) for name in ("length_m", "width_m"))
            box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
            c, s = float(np.cos(yaw)), float(np.sin(yaw))
            if shapely.affinity.affine_transform(box, [c, -s, s, c, x, y]).intersects(own):
                met.add(int(there["agent"][row]))
        self.meetings += len(met - self._met)
        self._met, self.is_met = frozenset(met), bool(met)

    def _look(self) -> list[int]:
        below = self.below = surface_below(self._surfaces, self.camera_place, self.below)
        viewpoint = Viewpoint(position=self.camera_place, altitude_m=REAR.z_m, yaw_rad=self.state.yaw_rad)
        is_capture = self._captured_m >= CAPTURE_EVERY_M
        targets = self._surfaces.query(self._window(), predicate="intersects").tolist()
        visibility = self.seen.look(sorted(targets), self._trace, self.time_s, viewpoint, counts=is_capture)
        self.looks.append(visibility)
        if not is_capture:
            return []
        self._captured_m = 0.0
        x, y = self.camera_place
        self.captures.append(Capture(self.time_s, x, y, self.state.yaw_rad, below, visibility))
        return self._detect(viewpoint, below)

    def _window(self) -> shapely.Polygon:
        """The ground in the image."""
        across, along = self.camera.window_m(REAR.z_m)
        corners = ((along, across), (-along, across), (-along, -across), (along, -across))
        return shapely.Polygon([self.state.place(REAR.x_m + a / 2, b / 2) for a, b in corners])

    def _detect(self, viewpoint: Viewpoint, below: int) -> list[int]:
        """Judge the sensor's detections of the latest capture, and return the defects that they confirm."""
        environment, sensing, window = self.environment, self.settings.sensing, self._window()
        sightings = []
        for number in self._defects_in(window):
            shares = environment.ground.defect_shares(number, self._trace, self.time_s, viewpoint)
            self.looks_at.setdefault(number, DefectLooks()).add(shares, self.time_s)
            if number in self.confirmed and not self.sensor.sees_confirmed:
                continue
            attempt = self._attempts[number]
            if attempt and sensing.attempts == "first_capture":
                continue
            if shares["visible"] >= sensing.min_visible_fraction:
                self._attempts[number] = attempt + 1
                sightings.append(environment.sighting(number, shares["visible"], attempt))
        if not sightings and not self.sensor.every_capture:
            return []
        frame = Frame(
            number=len(self.captures) - 1,
            time_s=self.time_s,
            position=self.camera_place,
            altitude_m=REAR.z_m,
            yaw_rad=self.state.yaw_rad,
            camera=REAR.camera,
            conditions=self.settings.conditions,
            velocity_mps=self.state.velocity_mps,
            exposure_s=shutter_s(self.settings),
            sun_elevation_deg=self._sun_deg,
            sightings=tuple(sightings),
        )
        found = self.detections.judge(frame, self.sensor.detect(frame), self.confirmed, segment=below, on_revisit=False)
        self.confirmed |= dict.fromkeys(found, self.time_s)
        return found

    def _defects_in(self, window: shapely.Polygon) -> list[int]:
        """Ids of the defects whose centre is in the window, in their order."""
        segments, world = self._surfaces.query(window, predicate="intersects").tolist(), self.environment.world
        here = [
            number for at in segments for number in self.environment.defects_by_segment.get(world.segments[at].id, ())
        ]
        shapely.prepare(window)
        return sorted(number for number in here if window.intersects(self.environment.defects[number].centre))


def drive_again(drive: Drive, changes: Iterable[InputChange[Pedals]]) -> None:
    """Repeat a recorded drive to its end.

    Args:
        drive: a new drive over the same inputs.
        changes: the recorded changes, in the order of time; the last one ends the drive.
    """
    pedals = input_by_step(changes, Pedals())
    while not drive.is_over:
        drive.step(next(pedals))
