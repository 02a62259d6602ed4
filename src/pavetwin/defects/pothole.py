"""Pothole (D40 in RDD2022): merged sub-bowls, a steep ragged rim, bare aggregate, loose stones, cracks around it.

Sizes of stones, ledges and bumps are metres, independent of depth: a deep hole is no rougher than a shallow one.
"""

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
from pydantic import Field

from pavetwin._core import relief_pebbles, relief_region
from pavetwin.arrays import BoolArray, Float32Array, Float64Array, IndexArray
from pavetwin.config.settings import Settings
from pavetwin.defects import poses
from pavetwin.defects.heightfield import Heightfield, Lattice, Marking, Stains
from pavetwin.defects.maps import distances_px, mean_around
from pavetwin.defects.registry import defect_class
from pavetwin.defects.severity import Distress, pothole_severity
from pavetwin.defects.shapes import (
    STEP_M,
    Range,
    Stroke,
    between,
    centres,
    counts,
    lattice_around,
    limited,
    log_between,
    noise,
    smooth,
    traced,
    turned,
    wandering,
)

STEEPEST = 1.8
"""Slope of a wall (61°): a course of 4 cm breaks over four cells. Holes too full for that are steeper."""

LAYER_M = (0.03, 0.05)
"""Thickness of the courses: the hole has a step where one debonds from the layer below."""

LEDGED, SHARPNESS = (-0.9, 0.7), 4.0
"""Ledges begin where a noise field exceeds the first value and are complete above the second; how much steeper they
are than the bowl."""

BROKEN_M = 0.009
"""Standard deviation of the ledges' edges from lines parallel to the rim."""

FIN_M = 0.012
"""Half of the least width of a tongue of the course between two breaks."""

SMOOTHED_M = 0.055
"""Notches of the rim that are narrower are smoothed out with depth."""

UNEVEN_M, AGGREGATE_M = 0.005, 0.005
"""Standard deviation of the floor's bumps, and greatest height of its stones above the gaps between them."""

FLOOR, WALL_BED = np.array([0.6, 0.9]), 0.3
"""Shares of the depth between which the wall becomes floor; share of the floor's roughness on a wall."""

REFINED, CLOSE = 0.35, 0.02
"""Range of the second search for the slopes' width, over all cells, as a logarithm; tolerance of the fullness."""

LEAST_SHARE = 0.025
"""Share of the depth that every cell of the hole, even a stone at its rim, is below the road."""

SETTLED, LEAST_BED_M = 0.6, 0.001
"""Step by which the bed is lowered when a hole cannot reach its fullness, and the bed that is always kept [m]."""

SOLVED_CELLS = 4000
"""Number of cells that give the volume to within a hundredth."""


def opened(rim_m: Float32Array, cell_m: float) -> tuple[BoolArray, Float32Array]:
    """(cells in the hole, distance from its rim [m], negative outside) for a rim.

    One hole without islands or fins: narrow remains of the course break off.
    """
    hole = relief_region(rim_m > 0, 0.0, FIN_M / cell_m)
    inner = distances_px(hole).astype(np.float32) * np.float32(cell_m)
    # Notches of the rim must not run down the walls as flutes: farther in, the distance is from a smoother rim.
    inner += smooth(inner, 0.004, 0.02) * (mean_around(inner, round(SMOOTHED_M / cell_m)) - inner)
    return hole, np.asarray(np.where(hole, inner - np.float32(cell_m / 2), np.minimum(rim_m, 0)), dtype=np.float32)


def dug(
    rng: np.random.Generator,
    lattice: Lattice,
    hole: BoolArray,
    inside_m: Float32Array,
    bed_m: Float32Array,
    depth_m: float,
    fullness: tuple[float, float],
) -> Float32Array:
    """Height of the hole with its floor, 0 outside, of the requested depth and fullness [m].

    The fullness is drawn from its range, but not above what walls of the steepest slope leave, while the range allows.
    """
    cells = np.flatnonzero(hole)
    layers = _layers(rng, depth_m)
    broken = noise(rng, lattice, 0.05, 3, 0.7).ravel()[cells]
    ledged = smooth(noise(rng, lattice, 0.16, 2).ravel()[cells], *LEDGED)
    uneven = min(UNEVEN_M, 0.12 * depth_m) * noise(rng, lattice, 0.13, 3, 0.6).ravel()[cells]
    inner = inside_m.ravel()[cells]
    moved = np.maximum(inner + BROKEN_M * broken * smooth(inner, 0.0, 0.03), 0)
    bed = bed_m.ravel()[cells] + uneven
    reach = float(np.quantile(inner, 0.97))
    few = np.arange(0, len(cells), max(1, len(cells) // SOLVED_CELLS))

    def level(width_m: float, some: IndexArray | slice) -> Float32Array:
        """Relative depth of a bowl with slopes of that width, 1 at the deepest."""
        wall = max(STEEPEST, 2 * depth_m / width_m)
        whole = min(1.0, reach / width_m)
        bowl = 1 - np.square(1 - np.minimum(moved[some] / np.float32(width_m), 1))
        bowl *= np.float32(depth_m / max(1e-9, float(bowl.max())))
        stepped = _stepped(bowl, layers)
        deep = np.minimum(bowl + whole * ledged[some] * (stepped - bowl), np.float32(wall) * inner[some])
        lying = smooth(deep, 0.0, min(0.03, 0.6 * depth_m)) * (
            WALL_BED + (1 - WALL_BED) * smooth(bowl, *FLOOR * depth_m)
        )
        deep = deep - bed[some] * lying
        return np.asarray(np.maximum(deep / deep.max(), np.float32(LEAST_SHARE)), dtype=np.float32)

    target = between(rng, fullness)
    fullest = float(level(2 * depth_m / STEEPEST, few).mean())
    target = max(fullness[0], min(target, fullest))
    found = _solved(level, few, reach, target)
    while float(found.mean()) < (1 - CLOSE) * target and float(np.abs(bed).max()) > LEAST_BED_M:
        bed *= np.float32(SETTLED)  # loose material would fill a shallow hole
        found = _solved(level, few, reach, target)
    height = np.zeros(lattice[0], dtype=np.float32)
    height.ravel()[cells] = np.float32(-depth_m) * found
    return height


def _solved(
    level: Callable[[float, IndexArray | slice], Float32Array], few: IndexArray, reach_m: float, target: float
) -> Float32Array:
    """Find the slopes' width whose mean depth is nearest to the target."""
    low, high = math.log(reach_m / 100), math.log(reach_m * 20)
    middle = 0.5 * (low + high)
    for _ in range(12):
        low, high = (middle, high) if float(level(math.exp(middle), few).mean()) > target else (low, middle)
        middle = 0.5 * (low + high)
    # The few cells represent all but the deepest point; where that matters all cells are used.
    found = level(math.exp(middle), slice(None))
    low, high = middle - REFINED, middle + REFINED
    for _ in range(7):
        if abs(float(found.mean()) / target - 1) < CLOSE:
            break
        low, high = (middle, high) if float(found.mean()) > target else (low, middle)
        middle = 0.5 * (low + high)
        found = level(math.exp(middle), slice(None))
    return found


def _layers(rng: np.random.Generator, depth_m: float) -> Float64Array:
    """Depths of the courses' lower faces, 0 first; the last is the floor."""
    ends = [0.0, min(between(rng, LAYER_M), float(rng.uniform(0.4, 0.75)) * depth_m)]
    while depth_m - ends[-1] > 1.4 * LAYER_M[1]:
        ends.append(ends[-1] + between(rng, LAYER_M))
    return np.array([*ends, depth_m])


def _stepped(deep: Float32Array, layers: Float64Array) -> Float32Array:
    """Slopes in steps: each course has a steep face and leaves a ledge down to the next one."""
    total = np.zeros_like(deep)
    for top, end in zip(layers[:-1].tolist(), layers[1:].tolist(), strict=True):
        sharpness = SHARPNESS if end < layers[-1] else 1.0
        total += np.clip(sharpness * (deep - np.float32(top)), 0, np.float32(end - top))
    return total


def aggregate(
    rng: np.random.Generator, lattice: Lattice, hole: BoolArray, size_m: float
) -> tuple[Float32Array, Float32Array]:
    """(tops of stones, tone of each) of a floor of coarse aggregate with finer stones between."""
    coarse, coarse_tone = relief_pebbles(lattice, hole, int(rng.integers(2**63)), size_m)
    fine, fine_tone = relief_pebbles(lattice, hole, int(rng.integers(2**63)), 0.55 * size_m)
    kept = coarse * (coarse_tone > 0.45)
    lower = 0.65 * fine
    return np.maximum(kept, lower), np.where(kept > lower, coarse_tone, fine_tone)


def loose_stones(
    rng: np.random.Generator, lattice: Lattice, inside_m: Float32Array, per_m2: float
) -> tuple[Float32Array, Float32Array]:
    """Loose stones of 1 to 4 cm on the floor, few near the rim: (height [m], share covered)."""
    (rows, cols), cell, _ = lattice
    height = np.zeros((rows, cols), dtype=np.float32)
    lying = np.zeros((rows, cols), dtype=np.float32)
    cells = np.flatnonzero(inside_m > 0.02)
    if len(cells) == 0:
        return height, lying
    x, y = centres(lattice)
    for at in rng.choice(cells, int(rng.poisson(per_m2 * len(cells) * cell**2))).tolist():
        row, col = divmod(at, cols)
        radius = 0.5 * min(0.04, 0.010 * float(rng.lognormal(0.25, 0.4)))
        reach = math.ceil(radius * 1.5 / cell)
        part = (slice(max(0, row - reach), row + reach + 1), slice(max(0, col - reach), col + reach + 1))
        cos, sin = math.cos(turn := float(rng.uniform(0, math.pi))), math.sin(turn)
        dx, dy = x[:, part[1]] - x[0, col], y[part[0]] - y[row, 0]
        u, v = (cos * dx + sin * dy) / (1.3 * radius), (cos * dy - sin * dx) / (0.8 * radius)
        top = np.clip(1 - np.abs(u) ** 2.5 - np.abs(v) ** 2.5, 0, 1)
        height[part] = np.maximum(height[part], 0.8 * radius * np.sqrt(top))
        lying[part] = np.maximum(lying[part], smooth(top, 0.0, 0.3))
    return height, lying


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
    """Longest side; where sub-bowls that hardly overlap come apart, only the largest, shorter one is left."""
    depth_m: Annotated[Range, limited(0.002, 1.0)] = (0.013, 0.2)
    """Greatest depth; log-uniform, and not above 0.25 of the diameter while the range allows."""
    fullness: Annotated[Range, limited(0.05, 1.0, unit="")] = (0.5, 0.85)
    """Ratio of its volume to that of a cylinder of its rim and depth: a cone has 1/3, a box 1. Holes too narrow for
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
    """Sample poses: mostly in wheel paths, some near the edges, in any direction."""
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
