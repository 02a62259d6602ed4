"""The kernels, in Rust. World frame: east-north-up, metres; yaw counter-clockwise from east, radians; time in seconds.

Every error that a user can mend is raised as `pavetwin.errors.PaveTwinError` with the kernel's own words.
"""

from typing import TypedDict, overload

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]
Indices = npt.NDArray[np.uint32]
Flags = npt.NDArray[np.bool_]
Point = tuple[float, float]

__version__: str

class PoseColumns(TypedDict):
    """Agents at one time, one array of shape (n,) a column."""

    agent: Indices
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    east_mps: Floats
    north_mps: Floats
    length_m: Floats
    width_m: Floats
    height_m: Floats
    is_pedestrian: Flags

class TrackColumns(TypedDict):
    """x_t over time, one array of shape (n,) a column."""

    t_s: Floats
    x_m: Floats
    y_m: Floats
    altitude_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    battery: Floats
    mode: npt.NDArray[np.uint8]
    segment: npt.NDArray[np.int32]
    visibility: Floats

class CaptureColumns(TypedDict):
    """Every capture, one array of shape (n,) a column."""

    t_s: Floats
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    segment: npt.NDArray[np.int32]
    visibility: Floats
    on_revisit: Flags

class LookColumns(TypedDict):
    """What one look shows of a segment."""

    visibility: float | None
    """o; None when C is empty."""
    hidden_place: Point | None
    """Centroid of C less V."""
    candidates: Floats
    """(n, 2), the centres of the cells of C."""
    visible: Floats
    """(m, 2), the centres of the cells of V."""

class NavMesh:
    """Where the UAV may fly at one altitude: convex polygons baked by Recast."""

    @staticmethod
    def bake(
        vertices: Floats, triangles: Indices, *, cell_size_m: float = 0.25, agent_radius_m: float = 0.5
    ) -> NavMesh:
        """From a flight domain: vertices (n, 2), triangles (m, 3) of any winding."""

    @staticmethod
    def from_polygons(vertices: Floats, offsets: Indices, corners: Indices) -> NavMesh:
        """From saved polygons: polygon i is vertices[corners[offsets[i]:offsets[i + 1]]]."""

    def vertices(self) -> Floats:
        """(n, 2)."""

    def offsets(self) -> Indices:
        """(polygons + 1,) into `corners`."""

    def corners(self) -> Indices:
        """Indices of vertices, polygon after polygon, counter-clockwise."""

    def area_m2(self) -> float: ...
    def contains(self, east_m: float, north_m: float) -> bool: ...
    def nearest(self, east_m: float, north_m: float) -> Point:
        """The closest point of the mesh."""

    def component_of(self, east_m: float, north_m: float) -> int | None:
        """The connected part that a point lies in; none outside the mesh."""

    def path(self, start: Point, goal: Point) -> Floats:
        """The shortest way (k, 2), both ends included."""

class Trace:
    """The recorded traffic, interpolated between its steps."""

    def __init__(
        self,
        *,
        step_s: float,
        step_offsets: Indices,
        agent: Indices,
        x_m: Singles,
        y_m: Singles,
        yaw_rad: Singles,
        speed_mps: Singles,
        length_m: Singles,
        width_m: Singles,
        height_m: Singles,
        base_m: Singles,
        is_pedestrian: Flags,
        known: Trace | None = None,
    ) -> None:
        """`known`: a trace whose rows are the first of these, so that only what follows is worked out."""
    @property
    def duration_s(self) -> float: ...
    @property
    def row_count(self) -> int: ...
    def agents_at(self, time_s: float) -> PoseColumns: ...
    def agents_near(self, east_m: float, north_m: float, radius_m: float, time_s: float) -> PoseColumns:
        """Those whose body may reach into the disc."""

class Ground:
    """What stands still at one altitude. Ragged arrays are given as offsets (k + 1,) into their values."""

    def __init__(
        self,
        mesh: NavMesh,
        *,
        cell_m: float,
        surface_rings: list[list[Floats]],
        solid_offsets: Indices,
        solid_xy: Floats,
        solid_z0: Floats,
        solid_z1: Floats,
        defect_centres: Floats,
        defect_offsets: Indices,
        defect_points: Floats,
        defect_segments: Indices,
    ) -> None: ...
    def cell_count(self, segment: int) -> int: ...
    def observe(
        self,
        segment: int,
        trace: Trace,
        time_s: float,
        *,
        position: Point,
        altitude_m: float,
        yaw_rad: float,
        image_px: tuple[int, int],
        vertical_fov_rad: float,
        window_rows: float,
        window_columns: float | None,
        window_across_per_altitude: float | None,
    ) -> LookColumns:
        """One look at a segment, without a mission: which cells are candidates, and which of them are visible."""

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

    @property
    def number(self) -> int:
        """Its row in `Flight.captures()`."""

    @property
    def time_s(self) -> float: ...
    @property
    def position(self) -> Point: ...
    @property
    def altitude_m(self) -> float: ...
    @property
    def yaw_rad(self) -> float: ...
    @property
    def velocity_mps(self) -> Point:
        """Of the UAV over the ground, (east, north)."""

    @property
    def segment(self) -> int: ...
    @property
    def on_revisit(self) -> bool: ...
    @property
    def visibility(self) -> float | None:
        """o; None when C is empty."""

    @property
    def sightings(self) -> list[tuple[int, float]]:
        """(defect, visible fraction); may be empty when the flight stops at every capture."""

class Occluded:
    """A look below τ_o, and the episode of occlusion that it belongs to."""

    @property
    def time_s(self) -> float: ...
    @property
    def visibility(self) -> float: ...
    @property
    def hidden_place(self) -> Point | None: ...
    @property
    def since_s(self) -> float: ...
    @property
    def waited_s(self) -> float: ...
    @property
    def displacements(self) -> int: ...
    @property
    def since_displacement_m(self) -> float: ...

class Moment:
    """One moment of a mission; immutable."""

    def agents(self) -> PoseColumns: ...
    def predict(self, displacements: Floats) -> Floats:
        """(n, 2) displacements to (n,) predicted visible shares of the cells now hidden; −1 outside the mesh."""

class Flight:
    """One UAV: takes commands, and runs to the next event."""

    def __init__(
        self,
        ground: Ground,
        trace: Trace,
        *,
        base: Point,
        altitude_m: float,
        time_step_s: float,
        radius_m: float,
        inspect_speed_mps: float,
        transit_speed_mps: float,
        acceleration_mps2: float,
        yaw_rate_rad_s: float,
        stopping_distance_m: float,
        climb_speed_mps: float,
        image_px: tuple[int, int],
        vertical_fov_rad: float,
        window_rows: float,
        window_columns: float | None,
        window_across_per_altitude: float | None,
        look_steps: int,
        capture_steps: int,
        threshold: float,
        min_visible_fraction: float,
        drain_per_s: Floats,
        drain_step_mps: float,
        drain_per_m_climbed: float,
        wind_mps: Point,
        reserve: float,
        every_capture: bool = False,
    ) -> None:
        """`every_capture`: stop at every capture, not only at those that show a wanted defect."""

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
    def inspect(self, segment: int, line: Floats) -> None: ...
    def revisit(self, segment: int, stay_s: float) -> None: ...
    def swap_battery(self, swap_s: float) -> None: ...
    def wait(self, seconds: float) -> None: ...
    def displace(self, east_m: float, north_m: float, stay_s: float) -> None: ...
    def extend(self, trace: Trace) -> None: ...
    def remaining(self) -> Floats:
        """(k, 2), what is left of the line under inspection."""

    def moment(self) -> Moment | None: ...
    def set_wanted(self, defect: int, wanted: bool) -> None: ...
    def surface_coverage(self, segment: int) -> float: ...
    def swept(self) -> Flags: ...
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

# Surface relief. Fields are (rows, cols) with row 0 at the smallest y; a lattice is (shape, side of a cell in metres,
# centre of the first cell in metres).

Shape = tuple[int, int]
Lattice = tuple[Shape, float, Point]

def relief_noise(lattice: Lattice, seed: int, wavelength_m: Point, octaves: int, gain: float) -> Singles:
    """Fractal value noise of mean 0 and standard deviation about 1; each octave has half the wavelength before."""

def relief_trace(
    lattice: Lattice, points: Floats, offsets: Indices, half_m: Floats, depth_m: Floats, reach_m: float, steepness: int
) -> tuple[Singles, Singles, Singles]:
    """Cracks along lines: (height [m], share of the cell that is open, distance from the nearest edge [m]).

    `points` (n, 2) are cut into lines by `offsets`; `half_m` (n, 2) opens to the left and right of a line.
    """

def relief_blocks(
    lattice: Lattice, wanted: Flags, sites: Floats, half_exponent: int, warp_x: Singles, warp_y: Singles, reach_m: float
) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16], Singles]:
    """Cells of sites under a Minkowski metric: (own site, site beyond the nearest joint, distance to that joint)."""

def relief_pebbles(lattice: Lattice, wanted: Flags, seed: int, size_m: float) -> tuple[Singles, Singles]:
    """Tops of stones: (1 at a top and 0 between stones, a tone in [0, 1) for each stone)."""

def relief_region(marked: Flags, margin: float, closing: float) -> Flags:
    """Marked cells widened by `margin`, closed by `closing` (cells), the largest part of that without its holes."""

def relief_largest_part(inside: Flags, diagonal: bool) -> Flags:
    """The largest part in one piece."""

def relief_outline(inside: Flags) -> Floats:
    """The outer ring (n, 2) of a region as (col, row), anticlockwise, through the middles of cell sides."""

def relief_widths(opening: Singles) -> Singles:
    """How wide the opening is at each cell, in cells; 0 where there is none."""

def relief_mesh(
    lattice: Lattice, height_m: Singles, ring: Floats, tolerance_m: float, most: int
) -> tuple[Singles, Indices, float] | None:
    """(vertices (n, 3), triangles (m, 3), largest error [m]) within a ring at height 0; None if it crosses itself."""

def texture_sample(levels: list[Singles], uv: Floats, level: Singles, wraps: bool) -> Singles:
    """(n, c) values at (n, 2) texture coordinates and (n,) levels, trilinear.

    Args:
        levels: (k, k, c) each, halved from one to the next; row 0 at v = 0, texel centres at (i + ½) / k.
        uv: 0 … 1 over the texture.
        level: 0 for the first.
        wraps: it repeats; else its edge texels go on outwards.
    """

def expose(
    light: npt.NDArray[np.uint16],
    *,
    seed: int,
    electrons_per_light: float,
    full_electrons: float,
    read_electrons: float,
    vignetting: float,
    blur_px: float,
    white_balance: tuple[float, float, float],
    saturation: float,
    sharpening: float,
    curve: Singles,
    depth: Singles | None = None,
    labels: Indices | None = None,
    focal_px: float = 1.0,
    still_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    moving_m: dict[int, tuple[float, float, float]] = {},
) -> npt.NDArray[np.uint8]:
    """What a camera stores, (height, width, 3) sRGB, of light (height, width, 4), half floats in kcd/m² seen as uint16.

    Args:
        light: red, green, blue, and one that is not read.
        seed: of the noise.
        electrons_per_light: of one pixel for each kcd/m², over the exposure.
        full_electrons: at which a pixel is full, at the ISO in use.
        read_electrons: standard deviation of the electronics.
        vignetting: share of the light that is missing in the corners.
        blur_px: standard deviation of the lens's point spread.
        white_balance: gains of red, green and blue.
        saturation: distance of colours from grey, 1 as they are.
        sharpening: how much of the difference to its neighbours is added to a pixel.
        curve: (n,) output 0 … 1 at inputs (i / (n − 1))².
        depth: (height, width) metres along the axis; None for no motion.
        labels: (height, width), to tell what moves by itself.
        focal_px: focal length.
        still_m: what stands still moves this in the camera's frame (right, down, forward) over the exposure, metres.
        moving_m: likewise of labelled things that move.
    """
