"""Distances on the raster of a ground tile: (cells along a side, side of a cell in metres). Fields are (px, px), row 0
south; coordinates are metres from the south-west corner."""

from pavetwin.arrays import Float32Array, Float64Array, Int32Array, UInt8Array, UInt32Array

Raster = tuple[int, float]

def raster_tracks(
    raster: Raster,
    points: Float64Array,
    offsets: UInt32Array,
    reach_m: Float64Array,
    begin_m: Float64Array,
    flat: bool,
) -> tuple[Int32Array, Float32Array, Float32Array, Float32Array]:
    """The nearest of some lines: (which, −1 for none; way along it; offset to its left; distance, infinite for none).

    `points` (n, 2) are cut into lines by `offsets`; each is looked for within its reach and begins at its way.
    """

def raster_painted(
    raster: Raster, rows: Float64Array, looks: Float32Array, most_m: Float32Array, outside_m: float
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """The bar that each cell lies farthest inside of: (signed distance from its edge, its first look, its second).

    `rows` (n, 8) are middle x and y, cosine and sine of the direction, half length and width, half the sides of the
    window in which a bar is looked for; distances above `most_m` (n,) count as that.
    """

def raster_covered(raster: Raster, rows: Float64Array, factors: Float32Array) -> Float32Array:
    """The factors (n,) of bars where they are, 1 elsewhere; later ones cover earlier ones, by shares of cells."""

def raster_weathered(
    *,
    on_road: Float32Array,
    land_tone: Float32Array,
    road_tone: Float32Array,
    repaired: Float32Array,
    stain: tuple[Float32Array, Float32Array],
    spilled: Float32Array,
    dust: tuple[Float32Array, Float32Array],
    wheels: Float32Array,
) -> UInt8Array:
    """(px, px, 4) the map of weathering from its fields: tone, stain, dust and polish.

    Stain and dust are what lies beside the kerb, and how much more lies on the carriageway.
    """

def raster_looked_up(table: Float32Array, rows: UInt32Array, columns: UInt32Array) -> Float32Array:
    """(rows, columns) the values of a table at some of its rows and columns."""
