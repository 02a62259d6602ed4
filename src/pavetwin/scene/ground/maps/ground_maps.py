"""The weathering and marking maps of a tile's ground: paint and bitumen as signed distances."""

from typing import Final

import numpy as np
import shapely

from pavetwin.arrays import Float32Array, UInt8Array
from pavetwin.scene.ground.ground_plan import GroundPlan
from pavetwin.scene.ground.maps.noise_tables import noise_tables
from pavetwin.scene.ground.maps.raster import RasterGrid, bytes_of, outlines, painted, tracks, widened
from pavetwin.scene.ground.maps.weathering import weathering
from pavetwin.scene.ground.materials.sampling import smoothstep
from pavetwin.scene.values import MAP_PX, SIGNED_DISTANCE_M, GroundMaps

PAINT_UNEVEN_M: Final = 0.0035  # Standard deviation of the edges of paint, from application and from wear
RAGGED: Final = 0.20  # Deviation of each edge of a seal, × half its width
TAPER_M: Final = 0.35  # A seal narrows over this length before its end
GONE_M: Final = 0.06  # Negative half width of a seal in its gaps, so that it tapers towards them


def drawn(plan: GroundPlan, key: tuple[int, int], worn: Float32Array) -> UInt8Array:
    """The map of paint and bitumen, (MAP_PX, MAP_PX, 4).

    Args:
        worn: (MAP_PX, MAP_PX) factor on the markings' own wear, from wheels and noise.
    """
    raster = RasterGrid(key)
    paint, reach = plan.paint, SIGNED_DISTANCE_M
    distance, which, wear = painted(raster, paint.bars, paint.bar_paints, plan.paint_limits, reach)
    low, high = plan.outline_boxes
    chosen = np.flatnonzero(raster.meets(low - reach, high + reach))
    for number, window, inside in outlines(raster, [paint.outlines[index] for index in chosen], reach):
        nearer = inside > distance[window.at]
        paint_wear = paint.outline_paints[chosen[number]]
        for field, value in ((distance, inside), (which, np.float32(paint_wear[0])), (wear, np.float32(paint_wear[1]))):
            np.copyto(field[window.at], value, where=nearer)
    near = distance > -reach
    if near.any():
        distance += _uneven(plan, key) * near
    wear = np.clip(wear * worn, 0.0, 1.0)
    return bytes_of(_coded(distance), which * 255, wear * 255, _coded(_bitumen(plan, raster)))


def _uneven(plan: GroundPlan, key: tuple[int, int]) -> Float32Array:
    """Offset of the edges of paint [m]."""
    tables = noise_tables(plan.seed)
    field = tables.plane(tables.fine, *RasterGrid(key, MAP_PX // 2).world_axes(), turn=7)
    return widened(np.clip(PAINT_UNEVEN_M * field, -0.008, 0.008).astype(np.float32), MAP_PX)


def _bitumen(plan: GroundPlan, raster: RasterGrid) -> Float32Array:
    """Signed distance to sealed cracks and seams: ragged, worn off in places, thin at their ends."""
    repairs = plan.repairs
    low, high = plan.seal_boxes
    near = np.flatnonzero(raster.meets(low - SIGNED_DISTANCE_M - 0.1, high + SIGNED_DISTANCE_M + 0.1))
    if not len(near):
        return raster.full(-SIGNED_DISTANCE_M)
    lines = [repairs.seals[index] for index in near]
    found = tracks(raster, lines, [SIGNED_DISTANCE_M] * len(near))
    mine = found.index >= 0
    which, along = found.index[mine], found.along[mine]
    halves, gaps = (np.array(of, dtype=np.float32)[near][which] for of in (repairs.seal_halves_m, repairs.seal_gaps))
    tables, name = noise_tables(plan.seed), near[which].astype(np.int64)
    half = halves + np.abs(halves) * RAGGED * tables.edge(along, 2 * name + (found.across[mine] > 0))
    # Gaps are where the noise is below the quantile of their share: a normal quantile, approximated by the logistic
    # function.
    least = 0.55 * np.log(gaps / (1 - gaps))
    half -= GONE_M * smoothstep(0.0, 0.5, least + 0.25 - tables.kept(along, name))
    lengths = np.array([float(shapely.LineString(line).length) for line in lines], dtype=np.float32)[which]
    closed = np.array([np.allclose(line[0], line[-1]) for line in lines])[which]
    to_end = np.where(closed, np.float32(9.0), np.minimum(along, lengths - along))
    half -= GONE_M / 2 * (1 - smoothstep(0.0, TAPER_M, to_end))
    signed = raster.full(-SIGNED_DISTANCE_M)
    # Between texel centres the crest of a line's distance is cut off, by a quarter of a texel on average.
    signed[mine] = half + np.float32(raster.cell_m / 4) - found.distance[mine]
    return signed


def _coded(distance: Float32Array) -> Float32Array:
    coded: Float32Array = np.clip(distance * np.float32(127 / SIGNED_DISTANCE_M) + 128, 1, 255)
    return coded


def ground_maps(plan: GroundPlan, key: tuple[int, int]) -> GroundMaps:
    """The maps of a tile. Neighbours agree where they overlap, to the size of a texel."""
    weathered, worn = weathering(plan, key)
    return GroundMaps(weathered, drawn(plan, key, worn))
