"""Pothole (D40 in RDD2022): merged sub-bowls, a steep ragged rim, bare aggregate, loose stones, cracks around it."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.config.base import Settings
from pavetwin.defects import poses
from pavetwin.defects.distress import Distress
from pavetwin.defects.heightfield import Heightfield, Lattice, Stains
from pavetwin.defects.marking import Marking
from pavetwin.defects.pit import AGGREGATE_M, aggregate, dug, loose_stones, opened
from pavetwin.defects.registry import defect_class
from pavetwin.defects.severity import pothole_severity
from pavetwin.defects.shapes import (
    Range,
    between,
    centres,
    counts,
    lattice_around,
    limited,
    log_between,
    noise,
    smooth,
    turned,
)
from pavetwin.defects.strokes import STEP_M, Stroke, traced, wandering

CELL_M = 0.005
MARKING = Marking(margin_m=0.02, closing_m=0.04)

DEEPEST_PER_DIAMETER = 0.25
"""Greatest depth as a share of the diameter: deeper holes would collapse."""

WALL_DIRT, WALL_DUST = 0.55, 0.35
"""The broken face of a bound course is dark with bitumen, that of the base below pale with fines."""

BOUND_M, BANDS_M = (0.05, 0.09), 0.012
"""Depth at which the bound courses end, drawn from this range, and its variation."""

PIECE_M = 0.011
"""Offset of the rim where a piece of the course has broken out."""

IN_WHEEL_PATH, AT_EDGE = 0.65, 0.20
"""Shares of potholes in wheel paths and near edges; the others are anywhere."""


class PotholeParameters(Settings):
    diameter_m: Annotated[Range, limited(0.1, 5.0)] = (0.25, 1.0)
    """Of its longest side; where sub-bowls that hardly overlap come apart, only the largest, shorter one is left."""
    depth_m: Annotated[Range, limited(0.002, 1.0)] = (0.013, 0.2)
    """Greatest depth; log-uniform, and not above 0.25 of the diameter while the range allows."""
    fullness: Annotated[Range, limited(0.05, 1.0, unit="")] = (0.5, 0.85)
    """Its volume over that of a cylinder of its rim and depth: a cone has 1/3, a box 1. Holes that are too narrow for
    such slopes are fuller."""
    bowls: Annotated[tuple[int, int], counts(1, 20)] = (2, 5)
    """Sub-bowls that have merged."""
    stone_m: Annotated[Range, limited(0.002, 0.1)] = (0.008, 0.02)
    """Size of the aggregate on its floor."""
    loose: Annotated[float, Field(ge=0, le=400)] = 60.0
    """Mean number of loose stones per square metre of floor."""
    cracks: Annotated[tuple[int, int], counts(0, 40)] = (1, 6)
    """Number of cracks that leave its rim."""


def sample_pothole_poses(rng: np.random.Generator, road: poses.RoadSection, count: int) -> poses.Poses:
    """Mostly in wheel paths, some near the edges, in any direction."""
    where = rng.random()
    if where < IN_WHEEL_PATH:
        offsets = poses.wheel_paths(rng, road, count)
    elif where < IN_WHEEL_PATH + AT_EDGE:
        offsets = poses.edges(rng, road, count)
    else:
        offsets = poses.anywhere(rng, road, count)
    return poses.poses(rng, offsets, 0.0, math.pi)


@defect_class(
    "pothole",
    sample_poses=sample_pothole_poses,
    rate=pothole_severity,
    width=lambda measures: measures.diameter_m,
    length=lambda measures: measures.crack_length_m,  # of those that leave its rim; 0 where none does
    weight=0.3,
    parameters=PotholeParameters,
    distress=Distress.POTHOLES,
)
def pothole(rng: np.random.Generator, parameters: PotholeParameters | None = None) -> Heightfield:
    """A hole around the origin, its longest side on x."""
    parameters = parameters or PotholeParameters()
    diameter = between(rng, parameters.diameter_m)
    low, high = parameters.depth_m
    depth = log_between((low, max(low, min(high, DEEPEST_PER_DIAMETER * diameter))), float(rng.random()))
    rim = _bowls(rng, parameters, diameter)
    cracks = _cracks(rng, parameters, rim, diameter, depth)
    ends = np.concatenate([rim[:, :2] - rim[:, 2:3], rim[:, :2] + rim[:, 2:3], *(crack.points for crack in cracks)])
    frayed_m = 0.03 + 0.15 * float(rim[:, 2].max())
    lattice = lattice_around(ends.min(axis=0), ends.max(axis=0), CELL_M, MARKING.margin_m + frayed_m)
    return _dug(rng, parameters, lattice, rim, depth, cracks)


def _bowls(rng: np.random.Generator, parameters: PotholeParameters, diameter_m: float) -> Float64Array:
    """(n, 3) centres and radii of the sub-bowls, their union `diameter_m` long on x and around the origin."""
    count = int(rng.integers(parameters.bowls[0], parameters.bowls[1] + 1))
    bowls = np.zeros((count, 3))
    bowls[:, 2] = rng.uniform(0.45, 1.0, count)
    for index in range(1, count):
        beside = bowls[int(rng.integers(index))]
        away = float(rng.uniform(0.45, 0.85)) * (beside[2] + bowls[index, 2])
        angle = float(rng.choice([0.0, math.pi])) + float(rng.normal(0.0, 0.8))
        bowls[index, :2] = beside[:2] + away * np.array([math.cos(angle), math.sin(angle)])
    low = (bowls[:, :2] - bowls[:, 2:]).min(axis=0)
    high = (bowls[:, :2] + bowls[:, 2:]).max(axis=0)
    bowls[:, :2] -= (low + high) / 2
    return np.asarray(bowls * diameter_m / float((high - low).max()))


def _inside(rng: np.random.Generator, lattice: Lattice, bowls: Float64Array) -> Float32Array:
    """Distance of each cell inside the rim [m], negative outside: the union of the bowls, its edge broken along stones.

    Pieces of the course break out as a whole: the edge has steps and corners.
    """
    x, y = centres(lattice)
    size = float(bowls[:, 2].max())
    sharp = np.float32(7.0 / size)
    total = np.zeros(lattice[0], dtype=np.float32)
    for bowl_x, bowl_y, radius in bowls.astype(np.float32):
        total += np.exp(sharp * (radius - np.sqrt((x - bowl_x) ** 2 + (y - bowl_y) ** 2)))
    # Overlapping bowls add to each other and would make the hole larger than requested.
    inside = np.log(np.maximum(total, np.float32(1e-20))) / sharp - np.float32(0.1 * size)
    inside += np.float32(0.08 * size) * noise(rng, lattice, 0.9 * size, 2, 0.5)
    pieces = noise(rng, lattice, 0.11, 2, 0.45)
    inside += np.float32(PIECE_M) * np.round(1.5 * pieces)
    inside += np.float32(0.003) * noise(rng, lattice, 0.03, 2, 0.75)
    edge = math.ceil(MARKING.margin_m / lattice[1]) + 2
    inside[:edge] = inside[-edge:] = inside[:, :edge] = inside[:, -edge:] = -1
    return np.asarray(inside, dtype=np.float32)


def _cracks(
    rng: np.random.Generator, parameters: PotholeParameters, bowls: Float64Array, diameter_m: float, depth_m: float
) -> list[Stroke]:
    """Cracks from within the rim outwards, and some along it."""
    strokes = []
    for _ in range(int(rng.integers(parameters.cracks[0], parameters.cracks[1] + 1))):
        x, y, radius = bowls[int(rng.integers(len(bowls)))]
        angle = float(rng.uniform(0.0, 2 * math.pi))
        around = rng.random() < 0.35
        length = diameter_m * float(rng.uniform(0.12, 0.45))
        count = max(8, math.ceil((length + (0.0 if around else 0.4 * radius)) / STEP_M))
        along = STEP_M * np.arange(count)
        side = 0.03 * wandering(rng, count, STEP_M, 0.4, 0.6)
        if around:
            ring = radius * float(rng.uniform(1.08, 1.25)) + side
            turn = angle + along / radius
            line = np.stack([ring * np.cos(turn), ring * np.sin(turn)], axis=1)
        else:
            line = turned(np.stack([0.6 * radius + along, side - side[0]], axis=1), angle)
        taper = np.sqrt(np.minimum(np.linspace(1.0, 0.0, count), np.linspace(0.0, 4.0, count) if around else 1.0))
        width = float(rng.uniform(0.002, 0.009))
        half = np.repeat((0.5 * width * taper)[:, None], 2, axis=1)
        strokes.append(Stroke(line + np.array([x, y]), half, min(0.02, 0.6 * depth_m) * taper))
    return strokes


def _dug(
    rng: np.random.Generator,
    parameters: PotholeParameters,
    lattice: Lattice,
    bowls: Float64Array,
    depth_m: float,
    cracks: list[Stroke],
) -> Heightfield:
    hole, inside = opened(_inside(rng, lattice, bowls), lattice[1])
    stones = between(rng, parameters.stone_m)
    dome, tone = aggregate(rng, lattice, hole, stones)
    fines = smooth(noise(rng, lattice, 0.18, 4, 0.6), 0.9 - 1.6 * float(rng.random()), 2.2)
    dome *= 1 - 0.8 * fines
    loose, lying = loose_stones(rng, lattice, inside, parameters.loose)
    rough = min(0.3 * stones, 0.2 * depth_m, AGGREGATE_M) * (dome - 0.6)
    bed = np.asarray(rough + loose * min(1.0, depth_m / 0.04), dtype=np.float32)
    height = dug(rng, lattice, hole, inside, bed, depth_m, parameters.fullness)
    lines = traced(lattice, cracks, 0.02)
    height = np.minimum(height, np.where(hole, 0, lines.height_m))
    opening = np.where(hole, np.float32(0), lines.opening)
    grain = noise(rng, lattice, 0.02, 2, 0.7)
    rim = smooth(inside, -0.03, 0.0) * ~hole
    floor = smooth(inside, 0.0, 0.008)
    wall = hole * smooth(np.hypot(*np.gradient(height, np.float32(lattice[1]))), 0.6, 1.3)
    # On a wall a cell is taller than wide: single stones would look like streaks.
    exposed = np.clip(
        floor * (0.35 + 0.4 * (dome + wall * (0.4 - dome))) + 0.7 * rim**3 * smooth(grain, 0.2, 1.2), 0, 1
    )
    pale, bound_m = float(rng.random()), between(rng, BOUND_M)
    noise_seed = int(rng.integers(2**63))

    def stains() -> Stains:
        blotch = noise(np.random.default_rng(noise_seed), lattice, 0.35, 3)
        deep = -height / depth_m
        damp = (1 - pale) * smooth(deep, 0.3, 1.0) * smooth(blotch, -0.8, 1.2)
        base = smooth(-height + BANDS_M * grain, bound_m, bound_m + 0.015)
        halo = smooth(inside, -0.12, 0.0) * smooth(blotch + 0.4 * grain, 0.0, 1.8)
        fouled = 0.8 * damp + hole * (
            0.45 * (1 - dome) * (1 - fines) * floor * (1 - wall) + WALL_DIRT * wall * (1 - base)
        )
        dusty = (0.15 + 0.4 * pale) * halo * ~hole + (0.2 + 0.7 * pale) * fines * floor + WALL_DUST * wall * base
        shown = hole * np.where(lying > 0, 0.8, 1 - 0.7 * fines) * (1 - 0.85 * wall)
        bright = np.where(hole, 2 * tone - 1, 0.5 * grain) * shown
        return Stains(
            dirt=_float32(np.clip(fouled, 0, 1)),
            dust=_float32(np.clip(dusty, 0, 1)),
            stone=lying,
            tone=_float32(np.clip(bright, -1, 1)),
        )

    return Heightfield(
        height_m=_float32(height),
        opening=_float32(opening),
        exposed=_float32(exposed),
        cell_m=lattice[1],
        origin_m=lattice[2],
        marking=MARKING,
        paint=stains,
    ).settled()


def _float32(field: Float32Array) -> Float32Array:
    return np.asarray(field, dtype=np.float32)
