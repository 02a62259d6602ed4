"""Weathering of a tile's ground by age, traffic, water and dirt: tone, stain, dust and polish."""

from dataclasses import dataclass
from functools import cached_property
from itertools import dropwhile, pairwise
from typing import Final

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin._core import raster_weathered
from pavetwin.arrays import Float32Array, Float64Array, UInt8Array
from pavetwin.scene.ground.distractors.repairs import WHEELS_M
from pavetwin.scene.ground.ground_plan import GroundPlan
from pavetwin.scene.ground.layout.lines import ways_along
from pavetwin.scene.ground.layout.relief import KERB_WIDTH_M
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.maps.noise_tables import NoiseTables, noise_tables
from pavetwin.scene.ground.maps.raster import RasterGrid, Tracks, covered, filled, tracks, widened
from pavetwin.scene.ground.materials.sampling import smoothstep
from pavetwin.scene.values import MAP_MARGIN_M, MAP_PX

STEPS: Final = 128  # Levels of a factor of 1, as the map itself has them


def shades(plan: GroundPlan, key: tuple[int, int], raster: RasterGrid) -> Float32Array | None:
    """Factor on the reflectance of the finish, (px, px), the mean over each cell; None where it is 1 everywhere."""
    box = tile_box(key, MAP_MARGIN_M + 0.1)
    index, surfaces = plan.paved
    shaded = [(index.shapes[number], surfaces[number].shade) for number in index.near(box)]
    shaded += [part for number in plan.holes.near(box) for part in _in_patch(plan, number)]
    drawn = list(dropwhile(lambda part: part[1] == 1.0, shaded))
    if not drawn:
        return None
    rings = [
        (part.exterior, min(255, round(shade * STEPS)))
        for shape, shade in drawn
        for part in shapely.get_parts(shape)
        if isinstance(part, Polygon)
    ]
    return filled(raster, rings, STEPS) / np.float32(STEPS)


def _in_patch(plan: GroundPlan, number: int) -> list[tuple[BaseGeometry, float]]:
    """Visible share of each pavement in a defect's hole, lower ones first, and the factors that make the patch's finish
    as bright as they are; nothing where there is one pavement only."""
    index, surfaces = plan.paved
    rest: BaseGeometry = plan.holes.shapes[number]
    patch = plan.paved_in(number)
    seen: list[tuple[BaseGeometry, float]] = []
    alike = True
    for above in reversed(index.near(rest)):
        surface = surfaces[above]
        alike = alike and surface.material == patch.material
        seen.insert(0, (shapely.intersection(rest, index.shapes[above]), surface.reflectance / patch.bare_reflectance))
        rest = shapely.difference(rest, index.shapes[above])
        if rest.is_empty:
            break
    return [] if alike else seen


EDGE_REACH_M: Final = 1.4  # Distance from the kerb within which it has dirt
SKID_GROWS: Final = 0.45  # Share of its length over which the mark of a locked wheel grows, as the tyre heats up. Ours.
SKID_ENDS_M: Final = 0.7  # And the length over which it ends, where the vehicle stands. Ours.
WHEEL_SPREAD_M: Final = 0.24  # Standard deviation of wheels around their path


@dataclass(frozen=True)
class _CoarseFields:
    """The low-frequency fields of a tile, at half resolution."""

    plan: GroundPlan
    key: tuple[int, int]

    @cached_property
    def raster(self) -> RasterGrid:
        return RasterGrid(self.key, MAP_PX // 2)

    @cached_property
    def box(self) -> shapely.Polygon:
        return tile_box(self.key, MAP_MARGIN_M + 0.1)

    @cached_property
    def tables(self) -> NoiseTables:
        return noise_tables(self.plan.seed)

    def plane(self, table: Float32Array, turn: int = 0) -> Float32Array:
        return self.tables.plane(table, *self.raster.world_axes(), turn=turn)

    @cached_property
    def segments(self) -> Tracks:
        near = self.plan.segment_index.near(self.box)
        pieces = [self.plan.segments[index] for index in near]
        lines = [shapely.get_coordinates(segment.centre_line) for segment, _ in pieces]
        found = tracks(self.raster, lines, [segment.width_m / 2 + 1.2 for segment, _ in pieces], flat=True)
        return _renumbered(found, near)

    @cached_property
    def lanes(self) -> Tracks:
        near = self.plan.lane_index.near(self.box)
        lanes = [self.plan.lanes[index][0] for index in near]
        lines = [shapely.get_coordinates(lane.centre_line) for lane in lanes]
        return _renumbered(tracks(self.raster, lines, [lane.width_m * 0.62 for lane in lanes]), near)

    @cached_property
    def edge(self) -> Tracks:
        """The kerb line; its way is the station, its left side the carriageway."""
        edges = self.plan.edges
        near = sorted(int(index) for index in edges.tree.query(self.box, "dwithin", distance=EDGE_REACH_M))
        lines = [shapely.get_coordinates(edges.pieces[index]) for index in near]
        return tracks(self.raster, lines, [EDGE_REACH_M] * len(near), [float(edges.begins[index]) for index in near])

    @cached_property
    def wheels(self) -> Float32Array:
        """How often wheels pass, 0 … 1: two paths a lane, and the ways across junctions."""
        lane = self.lanes
        away = np.abs(np.abs(lane.across) - WHEELS_M)
        paths = np.where(lane.index >= 0, np.exp(-0.5 * (away / WHEEL_SPREAD_M) ** 2), 0.0).astype(np.float32)
        return np.maximum(paths, np.minimum(self.turns, 1.0))

    @cached_property
    def turns(self) -> Float32Array:
        """Wheels that cross junctions, summed over the paths across."""
        passed = self.raster.full(0.0)
        reach = WHEELS_M + 0.5
        for index in self.plan.path_index.near(self.box, reach):
            line = self.plan.paths[index].line
            found = _ribbon(self.raster, line, reach)
            if found is None:
                continue
            window, across, _ = found
            passed[window] += np.float32(0.45) * np.exp(-0.5 * ((np.abs(across) - WHEELS_M) / 0.17) ** 2)
        return passed


def weathering(plan: GroundPlan, key: tuple[int, int]) -> tuple[UInt8Array, Float32Array]:
    """The map of weathering, (MAP_PX, MAP_PX, 4), and the factor on paint wear, (MAP_PX, MAP_PX)."""
    ground = _CoarseFields(plan, key)
    raster = RasterGrid(key)
    on_road = _road_share(plan, key, raster)
    repaired = _repair_tone(plan, raster)
    if (shade := shades(plan, key, raster)) is not None:
        repaired = repaired * shade
    layers = raster_weathered(
        on_road=on_road,
        land_tone=widened(_land_tone(ground), raster.px),
        road_tone=widened(_road_tone(ground), raster.px),
        repaired=repaired,
        stain=_beside_and_more(*_stain(ground), raster.px),
        spilled=_spilled(plan, raster),
        dust=_beside_and_more(*_dust(ground), raster.px),
        wheels=widened(ground.wheels, raster.px),
    )
    return layers, widened(_worn(ground), raster.px)


def _beside_and_more(beside: Float32Array, road: Float32Array, px: int) -> tuple[Float32Array, Float32Array]:
    """Values of a field next to the kerb and on the carriageway, each given on both sides: the first, and the excess of
    the second is, resampled."""
    return widened(beside, px), widened(road - beside, px)


def _road_tone(ground: _CoarseFields) -> Float32Array:
    """Reflectance factor from wheels, rollers and weather, before that of age."""
    plan, tables = ground.plan, ground.tables
    streets = ground.segments
    offset = plan.wear.parts[streets.index]
    streak, scuff, band = tables.road((tables.streak, tables.scuff, tables.band), streets.along, streets.across, offset)
    on_street = (streets.index >= 0).astype(np.float32)
    lanes = ground.lanes
    streaks, blotches = (table[streets.index] for table in (plan.wear.streaks, plan.wear.blotches))
    pass_tone = np.where(lanes.index >= 0, plan.wear.passes[lanes.index], 1.0)
    wheel = np.where(lanes.index >= 0, plan.wear.wheel_paths[lanes.index], -0.05) * ground.wheels
    slow = blotches * (
        0.030 * ground.plane(tables.broad) + 0.024 * ground.plane(tables.blotch) + 0.034 * ground.plane(tables.fine)
    )
    tone = pass_tone * (1.0 + on_street * streaks * (0.024 * streak + 0.028 * band + 0.014 * scuff) + wheel + slow)
    return np.asarray(tone, dtype=np.float32)


def _stain(ground: _CoarseFields) -> tuple[Float32Array, Float32Array]:
    """Stains at the kerb and on the carriageway: oil along lanes, rubber across junctions, damp at kerbs, spots."""
    tables, lanes, edge, dirt = ground.tables, ground.lanes, ground.edge, ground.plan.style.dirt
    middle = np.where(lanes.index >= 0, np.exp(-0.5 * (lanes.across / 0.33) ** 2), 0.0)
    (band,) = tables.road((tables.band,), lanes.along, lanes.across, lanes.index * np.int32(131))
    oily = np.clip(0.55 + 0.5 * band, 0.1, 1.6)
    stain = 0.095 * dirt.oil * ground.plan.wear.oil[lanes.index] * middle * oily
    stain = stain + 0.17 * dirt.tyre_marks * np.minimum(ground.turns, 1.5) * np.clip(
        0.8 + 0.3 * ground.plane(tables.blotch, 1), 0.2, 1.6
    )
    wet = np.clip(0.9 * ground.plane(tables.blotch, 2) + 0.7 * ground.plane(tables.broad, 1) - 0.75, 0.0, 1.0)
    away = edge.distance
    on_road = 0.55 * dirt.water * wet * np.exp(-((away / 0.28) ** 2)) + 0.30 * np.exp(-((away / 0.06) ** 2))
    beside = 0.14 * np.exp(-(((away - KERB_WIDTH_M) / 0.03) ** 2))
    spots = np.clip(1.6 * (ground.plane(tables.fine, 3) - 2.75), 0.0, 0.35)
    faint = np.clip(0.10 * (ground.plane(tables.blotch, 3) + 0.4 * ground.plane(tables.fine, 5) - 1.9), 0.0, 0.14)
    stain = stain + spots + faint
    return np.asarray(stain + beside, dtype=np.float32), np.asarray(stain + on_road, dtype=np.float32)


def _dust(ground: _CoarseFields) -> tuple[Float32Array, Float32Array]:
    """Dust at the kerb and on the carriageway."""
    tables, edge = ground.tables, ground.edge
    noise = ground.plane(tables.blotch, 4)
    distance = np.where(np.isfinite(edge.distance), edge.distance, np.float32(99.0))
    silt = 0.7 * np.exp(-distance / 0.17) * np.clip(0.65 + 0.5 * noise, 0.05, 1.6)
    film = 0.13 * np.exp(-((distance / 0.75) ** 2)) * np.clip(0.7 + 0.5 * ground.plane(tables.broad, 2), 0.0, 1.5)
    on_road = ground.plan.style.dirt.sand * (silt + film)
    beside = 0.25 * np.exp(-distance / 0.2) * np.clip(0.6 + 0.5 * noise, 0.0, 1.5)
    unused = np.where(ground.lanes.index >= 0, 0.05 * (1.0 - ground.wheels), 0.04)
    dust = unused * np.clip(0.6 + 0.6 * ground.plane(tables.broad, 3) + 0.3 * noise, 0.0, 2.0)
    beside, on_road = (np.clip(dust + each, 0.0, 0.85) for each in (beside, on_road))
    return np.asarray(beside, dtype=np.float32), np.asarray(on_road, dtype=np.float32)


def _land_tone(ground: _CoarseFields) -> Float32Array:
    tables = ground.tables
    slow = 0.055 * ground.plane(tables.broad, 5) + 0.022 * ground.plane(tables.blotch, 5)
    return np.asarray(1.0 + slow + 0.012 * ground.plane(tables.fine, 5), dtype=np.float32)


def _worn(ground: _CoarseFields) -> Float32Array:
    """Factor on the wear of paint: highest in wheel paths, with noise."""
    tables = ground.tables
    patchy = 0.16 * ground.plane(tables.blotch, 6) + 0.20 * ground.plane(tables.broad, 6)
    return np.asarray(np.clip(0.55 + 1.45 * ground.wheels + patchy, 0.15, 2.4), dtype=np.float32)


def _road_share(plan: GroundPlan, key: tuple[int, int], raster: RasterGrid) -> Float32Array:
    """Share of carriageway in each cell, with an antialiased edge."""
    road = plan.road_near(tile_box(key, 2.0))
    parts = [part for part in shapely.get_parts(road) if isinstance(part, shapely.Polygon)]
    rings = [(ring, 0 if number else 255) for part in parts for number, ring in enumerate(shapely.get_rings(part))]
    return filled(raster, rings, 0) / np.float32(255)


def _repair_tone(plan: GroundPlan, raster: RasterGrid) -> Float32Array:
    """Reflectance factor of patches and trenches, later ones over earlier ones, and of scars of markings."""
    tone = covered(raster, plan.patches[:, :5], plan.patches[:, 5])
    scars = plan.paint.scars
    return tone * covered(raster, scars[:, :5], scars[:, 5]) if len(scars) else tone


def _spilled(plan: GroundPlan, raster: RasterGrid) -> Float32Array:
    """Oil spots and the marks of locked wheels."""
    stain = raster.full(0.0)
    spots = plan.spots
    reach = 2.2 * spots[:, 2:3] + 0.04
    for number in np.flatnonzero(raster.meets(spots[:, :2] - reach, spots[:, :2] + reach)):
        at, radius = raster.local(spots[number, :2]), spots[number, 2]
        window = raster.window(at - reach[number], at + reach[number])
        if window is None:
            continue
        x, y = window.x - np.float32(at[0]), window.y - np.float32(at[1])
        turn = np.arctan2(y, x)
        lobes = 0.12 * np.sin(2 * turn + number) + 0.09 * np.sin(3 * turn + 2.3 * number)
        away = np.sqrt(x * x + y * y) * (1 + lobes + 0.06 * np.sin(5 * turn - number))
        blot = np.clip((radius + 0.02 - away) / max(0.03, 0.5 * radius), 0.0, 1.0)
        stain[window.at] = np.maximum(stain[window.at], np.float32(spots[number, 3]) * blot)
    low, high = plan.skid_boxes
    for number in np.flatnonzero(raster.meets(low - 0.2, high + 0.2)):
        line, strength = plan.repairs.skids[number]
        found = _ribbon(raster, line, 0.2)
        if found is not None:
            window_at, across, along = found
            length = float(ways_along(line)[-1])
            shown = smoothstep(0.0, SKID_GROWS * length, along) * smoothstep(length, length - SKID_ENDS_M, along)
            stain[window_at] += np.float32(strength) * shown * np.exp(-((across / 0.085) ** 4))
    return stain


def _ribbon(
    raster: RasterGrid, line: Float64Array, reach_m: float
) -> tuple[tuple[slice, slice], Float32Array, Float32Array] | None:
    """Offset to the left of a line in the window about it, far away where none is near, and the way along it; None if
    outside the grid."""
    points = raster.local(line)
    window = raster.window(points.min(axis=0) - reach_m, points.max(axis=0) + reach_m)
    if window is None:
        return None
    best = np.full((len(window.y), window.x.shape[1]), np.float32(9.0))
    across, along = best.copy(), np.zeros_like(best)
    rows, columns = window.at
    for (a, b), begin in zip(pairwise(points), ways_along(points).tolist(), strict=False):
        length = float(np.hypot(*(b - a)))
        near = raster.window(np.minimum(a, b) - reach_m, np.maximum(a, b) + reach_m)
        if length < 1e-6 or near is None:
            continue
        dx, dy = ((b - a) / length).astype(np.float32)
        x, y = near.x - np.float32(a[0]), near.y - np.float32(a[1])
        ahead, left = dx * x + dy * y, dx * y - dy * x
        away = np.hypot(left, np.maximum(np.maximum(-ahead, ahead - np.float32(length)), 0))
        part = (
            slice(near.at[0].start - rows.start, near.at[0].stop - rows.start),
            slice(near.at[1].start - columns.start, near.at[1].stop - columns.start),
        )
        nearer = away < best[part]
        np.copyto(across[part], np.copysign(away, left), where=nearer)
        np.copyto(along[part], np.float32(begin) + np.clip(ahead, 0, np.float32(length)), where=nearer)
        np.copyto(best[part], away, where=nearer)
    return window.at, across, along


def _renumbered(found: Tracks, numbers: list[int]) -> Tracks:
    """With the lines' numbers in the whole list."""
    table = np.array([*numbers, -1], dtype=np.int32)
    return Tracks(table[found.index], found.along, found.across, found.distance)
