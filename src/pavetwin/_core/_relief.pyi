"""Surface relief.

Fields are (rows, cols) with row 0 at the smallest y; a lattice is (shape, side of a cell in metres, centre of the first
cell in metres).
"""

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, UInt16Array, UInt32Array

Point = tuple[float, float]
Shape = tuple[int, int]
Lattice = tuple[Shape, float, Point]

def relief_noise(lattice: Lattice, seed: int, wavelength_m: Point, octaves: int, gain: float) -> Float32Array:
    """Fractal value noise of mean 0 and standard deviation about 1; each octave has half the wavelength before."""

def relief_trace(
    lattice: Lattice,
    points: Float64Array,
    offsets: UInt32Array,
    half_m: Float64Array,
    depth_m: Float64Array,
    reach_m: float,
    steepness: int,
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Cracks along lines: (height [m], share of the cell that is open, distance from the nearest edge [m]).

    `points` (n, 2) are cut into lines by `offsets`; `half_m` (n, 2) opens to the left and right of a line.
    """

def relief_blocks(
    lattice: Lattice,
    wanted: BoolArray,
    sites: Float64Array,
    half_exponent: int,
    warp_x: Float32Array,
    warp_y: Float32Array,
    reach_m: float,
) -> tuple[UInt16Array, UInt16Array, Float32Array]:
    """Cells of sites under a Minkowski metric: (own site, site beyond the nearest joint, distance to that joint)."""

def relief_pebbles(lattice: Lattice, wanted: BoolArray, seed: int, size_m: float) -> tuple[Float32Array, Float32Array]:
    """Tops of stones: (1 at a top and 0 between stones, a tone in [0, 1) for each stone)."""

def relief_region(marked: BoolArray, margin: float, closing: float) -> BoolArray:
    """Marked cells widened by `margin`, closed by `closing` (cells), the largest part of that without its holes."""

def relief_largest_part(inside: BoolArray, diagonal: bool) -> BoolArray:
    """The largest part in one piece."""

def relief_outline(inside: BoolArray) -> Float64Array:
    """The outer ring (n, 2) of a region as (col, row), anticlockwise, through the middles of cell sides."""

def relief_widths(opening: Float32Array) -> Float32Array:
    """How wide the opening is at each cell, in cells; 0 where there is none."""

def relief_mesh(
    lattice: Lattice, height_m: Float32Array, ring: Float64Array, tolerance_m: float, most: int
) -> tuple[Float32Array, UInt32Array, float] | None:
    """(vertices (n, 3), triangles (m, 3), largest error [m]) within a ring at height 0; None if it crosses itself."""
