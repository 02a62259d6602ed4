"""The recorded traffic, the camera, and what it sees of the ground."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypedDict

from pavetwin._core._navigation import NavMesh
from pavetwin.arrays import BoolArray, Float32Array, Float64Array, UInt32Array

Point = tuple[float, float]
"""East and north, metres."""

class PoseColumns(TypedDict):
    """Agents at one time, one array of shape (n,) a column."""

    agent: UInt32Array
    x_m: Float64Array
    y_m: Float64Array
    yaw_rad: Float64Array
    east_mps: Float64Array
    north_mps: Float64Array
    length_m: Float64Array
    width_m: Float64Array
    height_m: Float64Array
    is_pedestrian: BoolArray

class LookColumns(TypedDict):
    """What one look shows of a segment."""

    visibility: float | None
    """o; None when C is empty."""
    hidden_place: Point | None
    """Centroid of C less V."""
    permanently_hidden: float
    """Share that parked vehicles hide, of the cells in the window that no building, tree or street furniture hides."""
    candidates: Float64Array
    """(n, 2), the centres of the cells of C."""
    visible: Float64Array
    """(m, 2), the centres of the cells of V."""

class DefectShares(TypedDict):
    """What a camera sees of a defect, and what hides the rest: shares of its area. A part that several kinds of things
    hide counts for each of them."""

    visible: float
    behind_solids: float
    """Behind buildings, trees, street furniture."""
    behind_parked: float
    """Under or behind parked vehicles."""
    behind_vehicles: float
    """Behind moving ones."""
    behind_pedestrians: float

class ReachColumns(TypedDict):
    """Counts of a segment's cells."""

    cells: int
    """All."""
    visible: int
    """Seen from at least one viewpoint."""
    permanently_hidden: int
    """Seen from none, and not so if nothing were parked."""

class Trace:
    """The recorded traffic, interpolated between its steps."""

    def __init__(
        self,
        *,
        step_s: float,
        step_offsets: UInt32Array,
        agent: UInt32Array,
        x_m: Float32Array,
        y_m: Float32Array,
        yaw_rad: Float32Array,
        speed_mps: Float32Array,
        length_m: Float32Array,
        width_m: Float32Array,
        height_m: Float32Array,
        base_m: Float32Array,
        is_pedestrian: BoolArray,
    ) -> None: ...
    @staticmethod
    def of_parts(
        read: Callable[[int], Mapping[str, Any]],
        *,
        step_s: float,
        first_step: int,
        step_count: int,
        starts: Sequence[int],
        max_speed_mps: float,
        length_m: Float32Array,
        width_m: Float32Array,
        height_m: Float32Array,
        base_m: Float32Array,
        is_pedestrian: BoolArray,
        known: Trace | None = None,
        held_rows: int | None = None,
    ) -> Trace:
        """A recording that is read part by part, when the clock gets there.

        Args:
            read: gives the key frames of a part by its number, as `pavetwin.traffic.trace.KeyFrameColumns`. What it
                raises comes out of every call that needs the part, unchanged.
            first_step: of the recording, which is time 0.
            step_count: from there on.
            starts: the first step of each part, ascending from 0.
            max_speed_mps: at least the largest speed.
            known: a trace with which this one begins, whose parts in memory are used again.
            held_rows: poses that stay in memory beside those in use; some three million unless given.
        """
    duration_s: Final[float]
    def agents_at(self, time_s: float) -> PoseColumns: ...
    def agents_near(self, east_m: float, north_m: float, radius_m: float, time_s: float) -> PoseColumns:
        """Those whose body may reach into the disc."""

class NadirCamera:
    """A camera that looks straight down, its image rows along the track, and its inspection window."""

    def __init__(
        self,
        *,
        image_px: tuple[int, int],
        vertical_fov_rad: float,
        window_rows: float,
        window_columns: float | None = None,
        window_across_per_altitude: float | None = None,
    ) -> None:
        """Give exactly one of `window_columns` and `window_across_per_altitude`.

        Args:
            image_px: width (across the track), height (along it).
            vertical_fov_rad: angle between the first and the last image row, in (0, π).
            window_rows: central share of the rows in the window, in (0, 1].
            window_columns: central share of the columns in the window, in (0, 1].
            window_across_per_altitude: width of the window in metres a metre of altitude, at most the footprint's.

        Raises:
            PaveTwinError: a value is out of range.
        """

    image_px: Final[tuple[int, int]]
    vertical_fov_rad: Final[float]
    window_rows: Final[float]
    window_columns: Final[float | None]
    window_across_per_altitude: Final[float | None]
    def window_m(self, altitude_m: float) -> tuple[float, float]:
        """The inspection window on the ground (across the track, along it)."""

class Viewpoint:
    """Where a camera is and which way it is turned."""

    def __init__(self, *, position: Point, altitude_m: float, yaw_rad: float) -> None:
        """
        Args:
            position: the nadir, (east, north) in metres.
            altitude_m: of the camera above the ground, above 0.
            yaw_rad: the direction in which the image rows count.

        Raises:
            PaveTwinError: a value is not finite, or the altitude not above 0.
        """

    position: Final[Point]
    altitude_m: Final[float]
    yaw_rad: Final[float]

class Ground:
    """What stands still at one altitude. Ragged arrays are given as offsets (k + 1,) into their values."""

    def __init__(
        self,
        mesh: NavMesh,
        *,
        cell_m: float,
        surface_rings: list[list[Float64Array]],
        solid_offsets: UInt32Array,
        solid_xy: Float64Array,
        solid_z0: Float64Array,
        solid_z1: Float64Array,
        solid_is_parked: BoolArray,
        defect_centres: Float64Array,
        defect_segments: UInt32Array,
        defect_points: Callable[[int], Float64Array],
    ) -> None:
        """Centres (n, 2) of defects, and the index of each one's segment.

        Args:
            defect_points: gives the sample points (k, 2) of a defect by its index; asked once for each defect of a
                segment, when that is first inspected.
        """

    def observe(
        self, segment: int, trace: Trace, time_s: float, camera: NadirCamera, viewpoint: Viewpoint
    ) -> LookColumns:
        """One look at a segment, without a mission: which cells are candidates, and which of them are visible."""

    def reach(
        self, segment: int, camera: NadirCamera, altitude_m: float, places: Float64Array, yaws_rad: Float64Array
    ) -> ReachColumns:
        """What the inspection windows over n places (n, 2) with yaws (n,) show together of a segment, without traffic.

        Raises:
            PaveTwinError: there is no such segment, or a value is not finite.
        """

    def defect_shares(self, defect: int, trace: Trace, time_s: float, viewpoint: Viewpoint) -> DefectShares:
        """What is seen of a defect, without a mission; the frame does not count.

        Raises:
            PaveTwinError: there is no such defect, or the time is outside the recording.
        """
