"""The inside of a pothole: walls in broken layers, a bowl with a nearly flat floor, stones on it.

Sizes of stones, ledges and bumps are metres, whatever the depth: a deep hole is no rougher than a shallow one.
"""

import math
from collections.abc import Callable

import numpy as np

from pavetwin._core import relief_pebbles, relief_region
from pavetwin.arrays import BoolArray, Float32Array, Float64Array, IndexArray
from pavetwin.defects.filters import distances_px, mean_around
from pavetwin.defects.heightfield import Lattice
from pavetwin.defects.shapes import between, centres, noise, smooth

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
    """The same slopes in steps: each course has a steep face and leaves a ledge down to the next one."""
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
