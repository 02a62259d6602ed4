"""Single crack (longitudinal and transverse cracking in ASTM D6433, D00 and D10 in RDD2022): an irregular line along,
across or oblique to the street, millimetres to centimetres wide."""

import math
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field

from pavetwin._core import relief_pebbles
from pavetwin.arrays import Float32Array, Float64Array, IndexArray
from pavetwin.config.settings import Settings
from pavetwin.defects import poses
from pavetwin.defects.heightfield import Heightfield, Lattice, Marking, Stains
from pavetwin.defects.poses import Position
from pavetwin.defects.registry import LabelRule, defect_class
from pavetwin.defects.severity import Distress, crack_severity
from pavetwin.defects.shapes import (
    STEP_M,
    Range,
    ShareRange,
    Stroke,
    between,
    counts,
    flaked,
    frayed,
    lattice_around,
    limited,
    log_between,
    noise,
    smooth,
    spread,
    traced,
    turned,
    wandering,
)

CELL_M = 0.005
REACH_M = 0.025
"""Distance from its edges within which a crack marks the surface."""

WANDER_M, HURST, LONGEST_M = 0.032, 0.68, 1.6
"""Deviation of a crack from a straight line: amplitude at a wavelength of 1 m, its Hurst exponent, longest
wavelength."""

WIDEST_PER_LENGTH = 1 / 40
"""Greatest width as a share of the length: short cracks are narrow."""

FRAYED_M, FRAYED_SHARE = 0.005, 0.10
"""Greatest standard deviation of an edge from the line: half a stone; more where pieces have broken off a wide crack,
as shares of half its width."""

FILLED_M = (0.02, 0.04)
"""Widths over which the fill of a crack becomes visible; thinner cracks are dark."""

FILL, CRUMB_M = 0.3, 0.012
"""Fill of a wide crack: dirt, as a share of its depth, and crumbs of that size."""

WALL = 2.2
"""Steepest slope of a wide crack's sides."""

STEP_APART_M, STEP_OVERLAP_M = (0.02, 0.055), (-0.03, 0.06)
"""An interrupted crack continues with an offset: the offset, and the overlap of the two tips. The closing of the label
rule keeps both in one outline."""

ACROSS, OBLIQUE = 0.35, 0.25
"""Shares of transverse and oblique cracks; the rest are longitudinal."""

ALONG_IN_WHEEL_PATH, ALONG_AT_JOINT = 0.60, 0.25
"""Shares of longitudinal cracks: in wheel paths (loads), at joints between lanes; the rest near the edges."""


class SingleCrackParameters(Settings):
    length_m: Annotated[Range, limited(0.05, 30.0)] = (0.5, 6.0)
    """Along its chord."""
    width_m: Annotated[Range, limited(0.001, 0.5)] = (0.002, 0.08)
    """Greatest width; log-uniform, since narrow cracks are the common ones, and not above a fortieth of the length
    while the range allows."""
    depth_m: Annotated[Range, limited(0.005, 1.0)] = (0.005, 0.06)
    """Depth above any fill; wider cracks are deeper."""
    wander: Annotated[Range, limited(0.01, 10.0, unit="")] = (0.6, 1.5)
    """Factor of the usual deviation from a straight line."""
    steps: Annotated[tuple[int, int], counts(0, 20)] = (0, 2)
    """Number of interruptions, where it continues with an offset."""
    branches: Annotated[float, Field(ge=0, le=5)] = 0.7
    """Mean number of branches per metre."""
    spalled: ShareRange = (0.0, 0.7)
    """Share of its length along which an edge has chipped."""
    overgrown: ShareRange = (0.0, 0.0)
    """Share of its length in which grass and moss grow. They are drawn by scenes, and change nothing of its shape."""


def sample_single_crack_poses(rng: np.random.Generator, road: poses.RoadSection, count: int) -> poses.Poses:
    """Sample poses: along the street in wheel paths, at joints and edges; across it; or obliquely."""
    manner = rng.random()
    if manner < ACROSS:
        position = Position.ACROSS
    elif manner < ACROSS + OBLIQUE:
        position = Position.OBLIQUE
    else:
        where = rng.random()
        beyond = Position.JOINT if where < ALONG_IN_WHEEL_PATH + ALONG_AT_JOINT else Position.EDGE
        position = Position.WHEEL_PATH if where < ALONG_IN_WHEEL_PATH else beyond
    return poses.positioned(rng, position, road, count)


@defect_class(
    "single_crack",
    sample_poses=sample_single_crack_poses,
    rate=crack_severity,
    width=lambda measures: measures.width_m,
    weight=0.5,
    # A line covers few pixels, and is visible at a lower contrast than a patch.
    label=LabelRule(least_side_px=16, least_short_side_px=2, least_area_px=8, least_contrast=10.0),
    is_thin=True,
    parameters=SingleCrackParameters,
    distress=Distress.LONGITUDINAL_AND_TRANSVERSE_CRACKING,
)
def single_crack(rng: np.random.Generator, parameters: SingleCrackParameters | None = None) -> Heightfield:
    """A crack with the middle of its chord at the origin, its chord on x."""
    parameters = parameters or SingleCrackParameters()
    length = between(rng, parameters.length_m)
    low, high = parameters.width_m
    width = log_between((low, max(low, min(high, WIDEST_PER_LENGTH * length))), float(rng.random()))
    rank = math.log(width / low) / math.log(high / low) if high > low else float(rng.random())
    depth = log_between(parameters.depth_m, 0.7 * rank + 0.3 * float(rng.random()))
    pieces = _pieces(rng, parameters, length, width, depth)
    branches = [branch for piece in pieces for branch in _branches(rng, piece, parameters.branches)]
    strokes = [*pieces, *branches]
    spalled, flake = between(rng, parameters.spalled), 0.006 + 0.35 * width
    flakes = [flaked(rng, piece, spalled, flake, float(rng.uniform(0.003, 0.008))) for piece in pieces]
    points = np.concatenate([stroke.points for stroke in strokes])
    marking = Marking()
    lattice = lattice_around(points.min(axis=0), points.max(axis=0), CELL_M, marking.margin_m + width + 0.02)
    return _painted(rng, lattice, strokes, flakes, marking)


def _pieces(
    rng: np.random.Generator, parameters: SingleCrackParameters, length_m: float, width_m: float, depth_m: float
) -> list[Stroke]:
    """The crack from end to end, in one part or in several that overlap."""
    count = max(8, math.ceil(length_m / STEP_M))
    x = np.linspace(-length_m / 2, length_m / 2, count)
    share = np.linspace(0.0, 1.0, count)
    y = WANDER_M * between(rng, parameters.wander) * wandering(rng, count, STEP_M, LONGEST_M, HURST)
    y -= y[0] + (y[-1] - y[0]) * share
    profile = _profile(rng, count)
    low, high = parameters.steps
    most = min(high, int(length_m / 0.6))
    cuts = np.sort(rng.uniform(0.15, 0.85, int(rng.integers(min(low, most), most + 1))))
    bounds = [0, *(cuts * count).astype(int).tolist(), count]
    pieces, aside = [], 0.0
    for index, (begin, end) in enumerate(pairwise(bounds)):
        overlap = round(float(rng.uniform(*STEP_OVERLAP_M)) / STEP_M) if index else 0
        begin = max(0, begin - overlap)
        if end - begin < 6:
            continue
        line = np.stack([x[begin:end], y[begin:end] + aside], axis=1)
        pieces.append(_opened(rng, line, width_m * profile[begin:end], depth_m, (index > 0, end < count)))
        aside += float(rng.choice([-1.0, 1.0])) * between(rng, STEP_APART_M)
    widest = max(float(piece.half_m.sum(axis=1).max()) for piece in pieces)
    scale = width_m / widest
    return [Stroke(piece.points, piece.half_m * scale, piece.depth_m) for piece in pieces]


def _profile(rng: np.random.Generator, count: int) -> Float64Array:
    """Relative width along its length, 1 where widest, varying over long and short wavelengths."""
    waves = wandering(rng, count, STEP_M, 1.2, 0.4)
    return np.asarray(np.clip(0.62 + 0.38 * waves / max(1e-6, float(np.abs(waves).max())), 0.22, 1.0))


def _opened(
    rng: np.random.Generator, line: Float64Array, width_m: Float64Array, depth_m: float, stepped: tuple[bool, bool]
) -> Stroke:
    """A line with a width, narrowing towards its ends over a tenth of its length, or over 8 cm at an interruption."""
    count = len(line)
    at = np.arange(count) * STEP_M
    ends = np.ones(count)
    for away, step in ((at, stepped[0]), (at[::-1], stepped[1])):
        reach = min(0.08 if step else max(0.15, 0.12 * at[-1]), 0.5 * at[-1])
        ends *= np.sqrt(np.clip((away + 0.5 * STEP_M) / reach, 0.0, 1.0))
    half = 0.5 * width_m * ends
    fray = frayed(rng, count, STEP_M, float(rng.uniform(0.010, 0.018)))
    rough = np.minimum(0.35 * half, FRAYED_M + FRAYED_SHARE * half)[:, None] * fray
    sides = np.maximum(half[:, None] + rough, 0.15 * half[:, None])
    depth = depth_m * np.clip(0.35 + 0.65 * ends * (0.8 + 0.2 * fray[:, 0]), 0.1, 1.0)
    return Stroke(line, sides, depth / max(1e-9, float(depth.max())) * depth_m)


def _branches(rng: np.random.Generator, piece: Stroke, per_m: float) -> list[Stroke]:
    """Short cracks that branch off at an angle."""
    branches = []
    for _ in range(int(rng.poisson(per_m * len(piece.points) * STEP_M))):
        start = int(rng.integers(len(piece.points)))
        length = min(0.6, 0.08 + float(rng.exponential(0.15)))
        count = max(5, math.ceil(length / STEP_M))
        forward = -1.0 if rng.random() < 0.5 else 1.0
        angle = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.35, 1.1)) + (math.pi if forward < 0 else 0.0)
        y = 1.3 * WANDER_M * wandering(rng, count, STEP_M, 0.4, HURST)
        line = np.stack([STEP_M * np.arange(count), y - y[0]], axis=1)
        own = float(piece.half_m[start].sum()) * float(rng.uniform(0.3, 0.7))
        taper = np.sqrt(np.linspace(1.0, 0.0, count))
        half = np.repeat((0.5 * max(own, 0.001) * taper)[:, None], 2, axis=1)
        branches.append(
            Stroke(turned(line, angle) + piece.points[start], half, float(piece.depth_m[start]) * 0.7 * taper)
        )
    return branches


def _painted(
    rng: np.random.Generator, lattice: Lattice, strokes: list[Stroke], flakes: list[Stroke], marking: Marking
) -> Heightfield:
    """The strokes as a heightfield with the stains of a crack; all of it lies near the strokes."""
    shape = lattice[0]
    crack, chips = traced(lattice, strokes, REACH_M, steepness=3), traced(lattice, flakes, 0.0, steepness=6)
    cells = np.flatnonzero(crack.distance_m < REACH_M)
    grain = noise(rng, lattice, 0.016, 2, 0.7).ravel()[cells]
    opening, chipped = crack.opening.ravel()[cells], chips.opening.ravel()[cells]
    near = smooth(crack.distance_m.ravel()[cells], REACH_M, 0.0)
    squared = near * near
    shown = smooth(grain, -1.2, 0.8)
    exposed = np.maximum(chipped * shown, 0.6 * squared * squared * smooth(grain, 0.4, 1.4)) * (1 - opening)
    flaked_m = chips.height_m.ravel()[cells] * (0.8 + 0.2 * np.clip(grain, -1, 1))
    height = crack.height_m.ravel()[cells]
    crumbs = np.zeros(1, dtype=np.float32)
    if max(float(stroke.half_m.sum(axis=1).max()) for stroke in strokes) > FILLED_M[0]:
        height, crumbs = _filled(rng, lattice, crack.distance_m.ravel()[cells], cells, height)
    noise_seed = int(rng.integers(2**63))

    def stains() -> Stains:
        patches = noise(np.random.default_rng(noise_seed), lattice, (0.5, 0.12), 3).ravel()[cells]
        return Stains(
            dirt=spread(shape, cells, 0.6 * squared * near * smooth(patches + 0.5 * grain, -0.5, 1.6)),
            dust=spread(shape, cells, 0.35 * near * smooth(patches, 0.3, -1.5)),
            stone=spread(shape, cells, crumbs),
            tone=spread(shape, cells, 0.5 * grain, -1, 1),
        )

    return Heightfield(
        height_m=spread(shape, cells, np.minimum(height, flaked_m), -1, 0),
        opening=crack.opening,
        exposed=spread(shape, cells, exposed),
        cell_m=lattice[1],
        origin_m=lattice[2],
        marking=marking,
        paint=stains,
    ).settled()


def _filled(
    rng: np.random.Generator, lattice: Lattice, distance_m: Float32Array, cells: IndexArray, height_m: Float32Array
) -> tuple[Float32Array, Float32Array]:
    """(height of a wide crack with sloped sides and its fill [m], share covered by crumbs) at the cells.

    The deepest point stays as deep as it was.
    """
    inner = np.clip(-distance_m, 0, None) + np.float32(lattice[1] / 2)
    wide = smooth(inner, FILLED_M[0] / 4, FILLED_M[1] / 3)
    rugged = 1 + 0.25 * noise(rng, lattice, 0.04, 3, 0.7).ravel()[cells]
    dirt = smooth(noise(rng, lattice, 0.15, 3, 0.6).ravel()[cells], -1.2, 1.6)
    dome, tone = relief_pebbles(lattice, spread(lattice[0], cells, -distance_m) > 0, int(rng.integers(2**63)), CRUMB_M)
    fallen = dome.ravel()[cells] * (tone.ravel()[cells] > 0.45)
    sides = np.maximum(height_m, -WALL * inner * np.clip(rugged, 0.5, 1.5))
    bed = sides * (1 - FILL * dirt) + np.minimum(0.5 * CRUMB_M * fallen, -0.3 * sides)
    filled = height_m + wide * (bed - height_m)
    filled *= min(1.5, float(height_m.min()) / min(-1e-9, float(filled.min())))
    return filled, 0.5 * wide * fallen
