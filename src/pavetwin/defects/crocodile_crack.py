"""Crocodile crack (alligator cracking in ASTM D6433, D20 in RDD2022): a connected network of cracks around angular
blocks, longer along the wheel path than across."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pavetwin._core import relief_blocks, relief_largest_part, relief_noise
from pavetwin.arrays import Float32Array, Float64Array, IndexArray, UInt16Array
from pavetwin.config.settings import Settings
from pavetwin.defects import poses
from pavetwin.defects.heightfield import Heightfield, Lattice, Marking, Stains
from pavetwin.defects.registry import LabelRule, defect_class
from pavetwin.defects.severity import Distress, crocodile_severity
from pavetwin.defects.shapes import (
    Range,
    ShareRange,
    between,
    centres,
    lattice_around,
    limited,
    log_between,
    noise,
    smooth,
    spread,
)

CELL_M = 0.005
MARKING = Marking(margin_m=0.03, closing_m=0.12)
BESIDE_M = (0.006, 0.018)
"""Width along a crack's edge that is broken or stained, from the least worn to the most."""

BENT = 0.10
"""Amplitude of the blocks' bent edges, as a share of a block's size."""

BITTEN_M = 0.004
"""Roughness of the blocks' edges at the size of stones."""

TILT_M = 0.006
"""Standard deviation of the height difference across a block, where the patch is worst."""

LOST_SHARE, LOST_M = 0.06, 0.025
"""Share of lost blocks where wear is 1, and the depth that they leave."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A patch and its pattern of blocks; fields (rows, cols)."""

    lattice: Lattice
    region: Float32Array
    """1 in the middle of the patch, 0 at its border, below 0 outside it."""
    wear: float
    sites: Float64Array
    """(blocks, 2) of the blocks [m]."""
    own: UInt16Array
    """A cell's block."""
    other: UInt16Array
    """The block beyond the nearest joint."""
    distance_m: Float32Array
    """Distance to that joint."""
    near: IndexArray
    """Flat indices of the cells near joints."""


class CrocodileCrackParameters(Settings):
    length_m: Annotated[Range, limited(0.2, 20.0)] = (2.5, 3.5)
    """Along the wheel path."""
    width_m: Annotated[Range, limited(0.2, 10.0)] = (1.5, 2.5)
    blocks: Annotated[Range, limited(1, 10_000, unit="")] = (60, 220)
    """Number of blocks, including those cut by its border: a third to half of them are whole."""
    crack_m: Annotated[Range, limited(0.0005, 0.2)] = (0.002, 0.025)
    """Width of its thinnest and of its widest cracks."""
    exponent: Annotated[Range, limited(1.0, 10.0, unit="")] = (1.5, 3.0)
    """Exponent of the Minkowski metric that shapes the blocks; rounded to halves."""
    wear: ShareRange = (0.0, 1.0)
    """Progress of the damage: width of the cracks, broken edges, tilted and lost blocks."""


def sample_crocodile_crack_poses(rng: np.random.Generator, road: poses.RoadSection, count: int) -> poses.Poses:
    """Sample poses in wheel paths, along them."""
    return poses.poses(rng, poses.wheel_paths(rng, road, count), 0.0, 0.04)


@defect_class(
    "crocodile_crack",
    sample_poses=sample_crocodile_crack_poses,
    rate=crocodile_severity,
    width=lambda measures: measures.width_m,
    weight=0.2,
    # A network has room for a block or two.
    label=LabelRule(least_side_px=8, least_short_side_px=8, least_area_px=20, least_contrast=17.0),
    parameters=CrocodileCrackParameters,
    distress=Distress.ALLIGATOR_CRACKING,
)
def crocodile_crack(rng: np.random.Generator, parameters: CrocodileCrackParameters | None = None) -> Heightfield:
    """A patch around the origin; x runs along the wheel path."""
    parameters = parameters or CrocodileCrackParameters()
    half = np.array([between(rng, parameters.length_m), between(rng, parameters.width_m)]) / 2
    half -= MARKING.margin_m
    count = round(log_between(parameters.blocks, float(rng.random())))
    wear = between(rng, parameters.wear)
    lattice = lattice_around(-half, half, CELL_M, MARKING.margin_m + 0.03)
    region, area = _region(rng, lattice, half)
    sites, size = _sites(rng, half, area, count)
    warp_x, warp_y = (
        np.asarray(BENT * size * noise(rng, lattice, size, 1) + BITTEN_M * noise(rng, lattice, 0.05, 2, 0.55))
        for _ in range(2)
    )
    halves = round(2 * between(rng, parameters.exponent))
    low, high = parameters.crack_m
    beside = BESIDE_M[0] + wear * (BESIDE_M[1] - BESIDE_M[0])
    reach = 0.5 * log_between((low, high), 0.3 + 0.7 * wear) + beside
    own, other, distance = relief_blocks(lattice, region > 0, sites, halves, warp_x, warp_y, reach)
    near = np.flatnonzero((distance < reach) & (region > 0))
    patch = Patch(lattice, region, wear, sites, own, other, distance, near)
    return _painted(rng, patch, _widths(rng, parameters, patch), beside)


def _region(rng: np.random.Generator, lattice: Lattice, half: Float64Array) -> tuple[Float32Array, float]:
    """1 in the middle of the patch, falling to 0 at its ragged border and below outside it; and the area within [m²].

    The border is a superellipse with noise. It is computed coarsely first to measure its extent, and then scaled to the
    requested extent.
    """
    seed = int(rng.integers(2**63))

    def field(lattice: Lattice, scale: Float64Array, middle: Float64Array) -> Float32Array:
        shape, cell, (x0, y0) = lattice
        moved = shape, cell, (x0 - float(middle[0]), y0 - float(middle[1]))
        x, y = centres(moved)
        u, v = np.square(x / np.float32(scale[0])), np.square(y / np.float32(scale[1]))
        ragged = relief_noise(moved, seed, (0.6 * float(scale[0]), 0.6 * float(scale[1])), 3, 0.6)
        return np.asarray(0.9 - np.sqrt(np.sqrt(u * u + v * v)) + np.clip(0.16 * ragged, -0.4, 0.2), dtype=np.float32)

    coarse = lattice_around(-1.3 * half, 1.3 * half, 0.03, 0.0)
    inside = relief_largest_part(field(coarse, half, np.zeros(2)) > 0, False)
    (rows, cols), origin = np.nonzero(inside), np.array(coarse[2])
    low = origin + 0.03 * np.array([cols.min(), rows.min()]) - 0.015
    high = origin + 0.03 * np.array([cols.max(), rows.max()]) + 0.015
    grown = 2 * half / (high - low)
    area = float(np.count_nonzero(inside)) * 0.03**2 * float(grown.prod())
    region = field(lattice, half * grown, -(low + high) / 2 * grown)
    # At full resolution it may reach a little farther; the lattice leaves space for the label region around it.
    edge = math.ceil(MARKING.margin_m / lattice[1]) + 2
    region[:edge] = region[-edge:] = region[:, :edge] = region[:, -edge:] = -1
    return region, area


def _sites(rng: np.random.Generator, half: Float64Array, area_m2: float, count: int) -> tuple[Float64Array, float]:
    """Sites of blocks on a jittered hexagonal lattice over the patch, `count` of them within it; the blocks' size."""
    stretch = np.array([float(rng.uniform(1.0, 1.25)), 1.0])
    size = math.sqrt(area_m2 / (0.87 * count * float(stretch.prod())))
    across = np.ceil(half / (size * stretch * [1.0, 0.87])) + 2
    grid_x, grid_y = np.meshgrid(np.arange(-across[0], across[0] + 1), np.arange(-across[1], across[1] + 1))
    places = np.stack([grid_x + 0.5 * (grid_y % 2), 0.87 * grid_y], axis=-1).reshape(-1, 2)
    return (places + rng.uniform(-0.36, 0.36, places.shape)) * size * stretch, size


def _widths(rng: np.random.Generator, parameters: CrocodileCrackParameters, patch: Patch) -> Float32Array:
    """(near,) width of the crack at the joint next to each of the near cells [m].

    Main cracks follow a smooth field that is longer along the wheel path; every joint also has its own rank;
    all are thinner towards the border.
    """
    (low, high), near, wear = parameters.crack_m, patch.near, patch.wear
    own, other = patch.own.ravel()[near].astype(np.uint32), patch.other.ravel()[near].astype(np.uint32)
    mixed = np.minimum(own, other) * np.uint32(0x9E3779B1) + np.maximum(own, other) * np.uint32(0x85EBCA77)
    mixed = np.bitwise_xor(mixed, np.uint32(rng.integers(2**32))) * np.uint32(0xC2B2AE3D)
    rank = (mixed // np.uint32(2**8)).astype(np.float32) / np.float32(2**24)
    mains = noise(rng, patch.lattice, (0.9, 0.45), 3, 0.6).ravel()[near]
    ripple = noise(rng, patch.lattice, 0.05, 2, 0.7).ravel()[near]
    worst = np.clip(2.2 * patch.region.ravel()[near], 0, 1)
    share = (0.2 + 0.8 * wear) * (0.2 + 0.8 * worst) * np.clip(0.30 + 0.22 * mains + 0.55 * rank * rank, 0, 1)
    share = np.clip(share + (0.02 + 0.06 * share) * ripple, 0, 0.3 + 0.7 * wear)
    return np.asarray(low * np.exp(np.float32(math.log(high / low)) * share), dtype=np.float32)


def _painted(rng: np.random.Generator, patch: Patch, width: Float32Array, joint_m: float) -> Heightfield:
    """Cracks, moved and lost blocks, and their stains on the surface. Most of it lies near joints."""
    lattice, near = patch.lattice, patch.near
    shape, cell = lattice[0], np.float32(lattice[1])
    distance, half = patch.distance_m.ravel()[near], 0.5 * width
    opening = spread(
        shape, near, (np.minimum(distance + cell / 2, half) - np.maximum(distance - cell / 2, -half)) / cell
    )
    opening *= relief_largest_part(opening > 0, True)
    share = opening.ravel()[near]
    out = np.clip(distance / (half + cell / 2), 0, 1)
    height = -np.clip(0.8 * width, 0.004, 0.02) * share * (1 - out * out)
    grain = noise(rng, lattice, 0.018, 2, 0.7)
    worn = np.clip(1.6 * patch.region.ravel()[near], 0, 1) * np.float32(patch.wear)
    edge, rough = distance - half, grain.ravel()[near]
    spall = smooth(edge, joint_m, 0.0) * smooth(rough + 2.4 * worn, 1.3, 2.3)
    height -= 0.004 * spall * (1 - share)
    beside = smooth(edge, joint_m, 0.0)
    sunken, gone = _moved(rng, patch, grain)
    exposed = np.maximum(spread(shape, near, 0.8 * spall), 0.7 * gone) * (1 - opening)
    noise_seed = int(rng.integers(2**63))

    def stains() -> Stains:
        patches = noise(np.random.default_rng(noise_seed), lattice, 0.5, 3).ravel()[near]
        return Stains(
            dirt=spread(shape, near, 0.55 * beside * beside * smooth(patches, -0.8, 1.5)),
            dust=spread(shape, near, 0.6 * beside * smooth(patches, 0.0, -1.5)),
            stone=np.zeros(shape, dtype=np.float32),
            tone=np.clip(0.5 * grain, -1, 1),
        )

    return Heightfield(
        height_m=spread(shape, near, height, -1, 0) * (1 - gone) + sunken - LOST_M * gone * (1 + 0.1 * grain),
        opening=opening,
        exposed=exposed,
        cell_m=lattice[1],
        origin_m=lattice[2],
        marking=MARKING,
        paint=stains,
    ).settled()


def _moved(rng: np.random.Generator, patch: Patch, grain: Float32Array) -> tuple[Float32Array, Float32Array]:
    """(height of tilted and sunken blocks [m], share of lost ones)."""
    sites, own, region, wear = patch.sites, patch.own, patch.region, patch.wear
    x, y = centres(patch.lattice)
    worst = np.square(np.clip(1.6 * region, 0, 1))
    a, b, c = (TILT_M * wear * rng.normal(size=(3, len(sites)))).astype(np.float32)
    b, c = b / np.float32(0.25), c / np.float32(0.25)
    level = a - b * sites[:, 0].astype(np.float32) - c * sites[:, 1].astype(np.float32)
    sunken = -np.abs(level[own] + b[own] * x + c[own] * y) * worst
    lost = rng.random(len(sites)) < LOST_SHARE * wear * wear
    gone = (lost[own] & (region > 0.15)) * smooth(patch.distance_m + 0.002 * grain, 0.0, 0.016)
    return sunken, np.asarray(gone, dtype=np.float32)
