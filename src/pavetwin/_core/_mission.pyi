"""The flight: its settings, the events it stops for, and what it leaves behind."""

from typing import Final, TypedDict, overload

from pavetwin._core._navigation import Limits
from pavetwin._core._sensing import Ground, NadirCamera, Trace
from pavetwin.arrays import BoolArray, Float64Array, Int32Array, UInt8Array

Point = tuple[float, float]
"""East and north, metres."""

class TrackColumns(TypedDict):
    """x_t over time, one array of shape (n,) a column."""

    t_s: Float64Array
    x_m: Float64Array
    y_m: Float64Array
    altitude_m: Float64Array
    yaw_rad: Float64Array
    speed_mps: Float64Array
    battery: Float64Array
    mode: UInt8Array
    segment: Int32Array
    visibility: Float64Array

class CaptureColumns(TypedDict):
    """Every capture, one array of shape (n,) a column."""

    t_s: Float64Array
    x_m: Float64Array
    y_m: Float64Array
    yaw_rad: Float64Array
    segment: Int32Array
    visibility: Float64Array
    on_revisit: BoolArray

class Battery:
    """What flying drains, in shares of the battery."""

    def __init__(
        self,
        *,
        drain_per_s: Float64Array,
        lift_per_s: Float64Array,
        drain_step_mps: float,
        drain_per_m_climbed: float,
        wind_mps: Point,
        reserve: float,
    ) -> None:
        """
        Args:
            drain_per_s: (n,) a second at airspeeds 0, 1, 2 … times `drain_step_mps`, without `lift_per_s`; linear
                between, constant beyond.
            lift_per_s: (n,) the part that moving through the air saves, at the airspeed, or at the ground speed where
                that is lower.
            drain_step_mps: airspeed between two entries.
            drain_per_m_climbed: a metre of climb, on top; a descent gives nothing back.
            wind_mps: velocity of the air over the ground, (east, north).
            reserve: share that must be left after landing, in [0, 1].

        Raises:
            PaveTwinError: a value is out of range.
        """

    def drained(self, velocity_mps: Point, *, climb_mps: float = 0.0, seconds: float = 1.0) -> float:
        """Share of the battery that flying at a velocity over the ground (east, north) drains in the wind."""

    drain_per_s: Final[Float64Array]
    lift_per_s: Final[Float64Array]
    drain_step_mps: Final[float]
    drain_per_m_climbed: Final[float]
    wind_mps: Final[Point]
    reserve: Final[float]

class FlightSettings:
    """How one mission is flown."""

    def __init__(
        self,
        *,
        altitude_m: float,
        time_step_s: float,
        radius_m: float,
        clearance_m: float,
        inspect: Limits,
        transit: Limits,
        stopping_distance_m: float,
        climb_speed_mps: float,
        camera: NadirCamera,
        look_steps: int,
        capture_steps: int,
        threshold: float,
        min_visible_fraction: float,
        battery: Battery,
        every_capture: bool = False,
    ) -> None:
        """
        Args:
            radius_m: of the UAV's body.
            clearance_m: an agent that reaches into the altitude ± this is kept clear of.
            inspect: limits while inspecting and displacing.
            transit: limits between segments, to revisits and home.
            stopping_distance_m: how far before the end of a line an inspection ends.
            climb_speed_mps: upwards and downwards.
            look_steps: time steps between two looks.
            capture_steps: time steps between two captures.
            threshold: τ_o; a look below it is an event.
            min_visible_fraction: a defect is sighted when at least this share of its area is visible.
            every_capture: stop at every capture, not only at those that show a wanted defect.

        Raises:
            PaveTwinError: a value is out of range.
        """

    altitude_m: Final[float]
    time_step_s: Final[float]
    radius_m: Final[float]
    clearance_m: Final[float]
    inspect: Final[Limits]
    transit: Final[Limits]
    stopping_distance_m: Final[float]
    climb_speed_mps: Final[float]
    camera: Final[NadirCamera]
    look_steps: Final[int]
    capture_steps: Final[int]
    threshold: Final[float]
    min_visible_fraction: Final[float]
    battery: Final[Battery]
    every_capture: Final[bool]

class Arrived:
    """The command has been carried out."""

class BatteryLow:
    """Going home now leaves just the reserve."""

class RecordingEnds:
    """The next step lies past the end of the recording."""

class Paused:
    """The moment given to `Flight.advance` is reached; nothing else has happened."""

class Captured:
    """A capture, and the wanted defects in it: centre in the inspection window, enough of the area visible."""

    number: Final[int]
    """Its row in `Flight.captures()`."""
    time_s: Final[float]
    position: Final[Point]
    altitude_m: Final[float]
    yaw_rad: Final[float]
    velocity_mps: Final[Point]
    """Velocity of the UAV over the ground, (east, north)."""
    segment: Final[int]
    on_revisit: Final[bool]
    visibility: Final[float | None]
    """o; None when C is empty."""
    sightings: Final[list[tuple[int, float]]]
    """(defect, visible fraction); may be empty when the flight stops at every capture."""

class Occluded:
    """A look below τ_o, and the episode of occlusion that it belongs to."""

    time_s: Final[float]
    visibility: Final[float]
    hidden_place: Final[Point | None]
    permanently_hidden: Final[float]
    """Share of the cells in the window that parked vehicles hide; they do not count in o."""
    since_s: Final[float]
    waited_s: Final[float]
    displacements: Final[int]
    since_displacement_m: Final[float]

class DisplacementPredictor:
    """Predicts visibility after displacements from the state of a flight at one time; immutable."""

    def predict(self, displacements: Float64Array) -> Float64Array:
        """(n, 2) displacements to (n,) predicted visible shares of the cells now hidden; −1 outside the mesh."""

class Flight:
    """One UAV: takes commands, and runs to the next event."""

    def __init__(self, ground: Ground, trace: Trace, settings: FlightSettings, *, base: Point) -> None:
        """On the ground at the base, at the beginning of the recording, with a full battery."""

    @overload
    def advance(self, until_s: None = None) -> Arrived | Captured | Occluded | BatteryLow | RecordingEnds: ...
    @overload
    def advance(self, until_s: float | None) -> Arrived | Paused | Captured | Occluded | BatteryLow | RecordingEnds:
        """Run to the next event, or to the first time step at or after `until_s` (`Paused`).

        What happens afterwards does not depend on such pauses.
        """

    def climb_to(self, altitude_m: float) -> None: ...
    def fly_to(self, goal: Point, *, revisit: bool = False, stop_short: bool = False) -> None: ...
    def fly_home(self) -> None: ...
    def turn_to(self, yaw_rad: float) -> None: ...
    def inspect(self, segment: int, line: Float64Array) -> None: ...
    def revisit(self, segment: int, stay_s: float) -> None: ...
    def steer(self, segment: int, *, ahead_mps: float, left_mps: float, turn_rad_s: float) -> None:
        """Fly by hand until another command, within the limits of transit, and look at a segment.

        Asked again it goes on with what is then asked for, and looks at the same intervals. It never arrives; before a
        command that flies elsewhere it must come to rest.

        Raises:
            PaveTwinError: there is no such segment, or the UAV still moves by another command.
        """

    def swap_battery(self, swap_s: float) -> None: ...
    def wait(self, seconds: float) -> None: ...
    def displace(self, east_m: float, north_m: float, stay_s: float) -> None: ...
    def extend(self, trace: Trace) -> None: ...
    def remaining(self) -> Float64Array:
        """(k, 2), what is left of the line under inspection."""

    def predictor(self) -> DisplacementPredictor | None:
        """From the present state; None when nothing is under inspection."""

    def set_wanted(self, defect: int, wanted: bool) -> None: ...
    def surface_coverage(self, segment: int) -> float: ...
    def swept(self) -> BoolArray: ...
    def track(self) -> TrackColumns: ...
    def captures(self) -> CaptureColumns: ...
    @property
    def time_s(self) -> float: ...
    @property
    def position(self) -> Point: ...
    @property
    def altitude_m(self) -> float: ...
    @property
    def yaw_rad(self) -> float: ...
    @property
    def speed_mps(self) -> float: ...
    @property
    def battery(self) -> float: ...
    @property
    def mode(self) -> int: ...
    @property
    def energy_used(self) -> float:
        """In batteries, over all swaps."""

    @property
    def distance_m(self) -> float: ...
    @property
    def waited_s(self) -> float: ...
    @property
    def occlusions(self) -> int: ...
