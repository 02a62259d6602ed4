"""The leaf atlas: twigs with leaves, drawn once, whose alpha cuts out the leaf cards of tree crowns.

A crown is made of cards, kinked quads that hold a twig each. The atlas has a cell for every kind of card: its colours
multiply the card's, its alpha is 255 on leaves and 0 in the gaps between them. A twig runs from the corner of its cell
nearest to (0, 0) to the opposite one, along the card's kink.

In coarser mip levels gaps and leaves are averaged, and an alpha test at one half would make crowns thinner or denser
with distance; so alpha is scaled on every level until the test keeps the same share as on the first (Castaño 2010,
Computing Alpha Mipmaps).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from pavetwin.arrays import AnyArray, Float64Array, UInt8Array
from pavetwin.scene.texture_cache import kept

SIDE_PX: Final = 512  # Side of the atlas [texels]; it has 2 × 2 cells
CUT: Final = 0.5
"""Threshold of the alpha test."""

SPRAY: Final = 3  # The cell filled with leaves, for the inside of a crown. The cells before it are twigs.
_CELL_PX: Final = SIDE_PX // 2
_FINE: Final = 2
"""Texels are means of so many by so many samples."""

_LEVELS: Final = 6  # Mip levels down to cells of 8 texels, before leaves bleed into neighbouring cells
_SEED: Final = 5


@dataclass(frozen=True, slots=True)
class _Leaf:
    """One leaf in a cell, whose side is 1."""

    foot: Float64Array  # (2,)
    angle_rad: float
    length: float
    slim: float  # Half its width over its length
    tone: float
    yellow: float


@cache
def leaf_atlas() -> UInt8Array:
    """(SIDE_PX, SIDE_PX, 4): linear factors of colour, 255 for 1, and alpha. Row 0 is v = 0; always the same bytes."""
    rng = np.random.default_rng(_SEED)
    drawn = [_cell(_twig(rng, leaves)) for leaves in (24, 21, 27)] + [_cell(_spray(rng))]
    rows = [np.concatenate(drawn[start : start + 2], axis=1) for start in (0, 2)]
    return np.concatenate(rows, axis=0)


@cache
def leaf_levels() -> tuple[UInt8Array, ...]:
    """The mip levels of the atlas, scaled for the alpha test at `CUT`: every cell keeps its share of leaves. From the
    cache."""
    return tuple(kept("leaves", lambda: {str(level): each for level, each in enumerate(_levels())}).values())


def _levels() -> tuple[UInt8Array, ...]:
    atlas = leaf_atlas()
    shares = [float((cell >= 255 * CUT).mean()) for cell in cells(atlas[..., 3])]
    levels = [atlas]
    texels = atlas / 255
    for _ in range(_LEVELS - 1):
        half = len(texels) // 2
        texels = texels.reshape(half, 2, half, 2, 4).mean(axis=(1, 3))
        cut = texels.copy()
        for share, cell in zip(shares, cells(cut[..., 3]), strict=True):
            cell *= CUT / max(float(np.quantile(cell, 1.0 - share)), 0.05)
        levels.append((255 * np.clip(cut, 0, 1) + 0.5).astype(np.uint8))
    return tuple(levels)


def cells(texels: AnyArray) -> list[AnyArray]:
    """Views of the cells of a level, in their order."""
    return [cell for row in np.split(texels, 2, axis=0) for cell in np.split(row, 2, axis=1)]


def _twig(rng: np.random.Generator, leaves: int) -> list[_Leaf]:
    """Leaves on three shoots: one along the diagonal, one to either side; painted in any order, those at tips last."""
    shoots = [(0.0, 0.0, 1.16), (rng.uniform(0.16, 0.24), rng.uniform(32, 42), 0.58)]
    shoots.append((rng.uniform(0.28, 0.34), -rng.uniform(32, 42), 0.52))
    found, tips = [], []
    for start, degrees, reach in shoots:
        heading = np.pi / 4 + np.radians(degrees)
        foot = np.array([start, start])
        count = round(leaves * reach / 2)
        for index in range(count):
            share = 0.14 + 0.80 * (index + rng.uniform(0.2, 0.8)) / count
            turn = (-1) ** index * np.radians(rng.uniform(35.0, 75.0) - 15.0 * share)
            length = rng.uniform(0.22, 0.30) * (1.0 - 0.25 * share)
            place = foot + share * reach * np.array([np.cos(heading), np.sin(heading)])
            found.append(_leaf(rng, place, heading + turn, length))
        end = foot + 0.94 * reach * np.array([np.cos(heading), np.sin(heading)])
        tips.append(_leaf(rng, end, heading + rng.uniform(-0.2, 0.2), 0.24))
    return [leaf for leaf in (*(found[index] for index in rng.permutation(len(found))), *tips) if leaf.length > 0.07]


def _spray(rng: np.random.Generator) -> list[_Leaf]:
    """Leaves all over a round cell, the outermost painted first."""
    count = 62
    away = 0.37 * np.sqrt((np.arange(count) + 0.5) / count)
    angle = np.arange(count) * 2.399963 + rng.normal(0.0, 0.2, count)
    # Outwards at the ragged rim, in any direction inside.
    turn = angle + rng.normal(0.0, np.where(away > 0.24, 0.6, 2.5))
    feet = 0.5 + away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return [_leaf(rng, feet[index], float(turn[index]), rng.uniform(0.17, 0.24)) for index in range(count)][::-1]


def _leaf(rng: np.random.Generator, foot: Float64Array, angle_rad: float, length: float) -> _Leaf:
    """A leaf that ends inside its cell."""
    heading = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    free = np.where(heading > 0, 0.985 - foot, foot - 0.015) / np.maximum(np.abs(heading), 1e-6)
    slim, tone = float(rng.uniform(0.27, 0.36)), float(np.clip(rng.normal(0.78, 0.16), 0.45, 1.0))
    return _Leaf(foot, float(angle_rad), float(min(length, free.min())), slim, tone, float(rng.normal(0.0, 0.5)))


def _cell(leaves: Sequence[_Leaf]) -> UInt8Array:
    """The image of some leaves, one over the other, each shading those below it."""
    side = _CELL_PX * _FINE
    colour, alpha = np.zeros((side, side, 3)), np.zeros((side, side))
    for leaf in leaves:
        low = np.clip(np.floor((leaf.foot - 1.1 * leaf.length) * side), 0, side).astype(int)
        high = np.clip(np.ceil((leaf.foot + 1.1 * leaf.length) * side), 0, side).astype(int)
        x, y = np.meshgrid((np.arange(low[0], high[0]) + 0.5) / side, (np.arange(low[1], high[1]) + 0.5) / side)
        tint, inside, shade = _blade(leaf, x, y, 1.0 / side)
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        below = colour[window] * ((1.0 - 0.5 * shade) * (1.0 - inside))[..., None]
        colour[window] = below + inside[..., None] * tint
        alpha[window] += inside - alpha[window] * inside
    return _texels(colour, alpha)


def _blade(
    leaf: _Leaf, x: Float64Array, y: Float64Array, sample: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Colours (m, n, 3) of one leaf at points (m, n), where it is (m, n), and where its shadow falls (m, n)."""
    cos, sin = np.cos(leaf.angle_rad), np.sin(leaf.angle_rad)
    dx, dy = x - leaf.foot[0], y - leaf.foot[1]
    along = (dx * cos + dy * sin) / leaf.length
    across = (dy * cos - dx * sin) / leaf.length
    # A stalk, then an oval blade with a drawn-out tip and small teeth.
    share = np.clip((along - 0.10) / 0.90, 0.0, 1.0)
    half = leaf.slim * np.sin(np.pi * share**0.72) * (1.0 - 0.35 * share**3)
    half = half * (1.0 + 0.05 * np.sin(60.0 * share)) + 0.02 * ((along > 0.0) & (along < 0.5))
    off = (half - np.abs(across)) * leaf.length
    inside = _ramp(off, sample) * ((along > 0.0) & (along < 1.0))
    shade = np.where((along > -0.1) & (along < 1.1), _ramp(off + 0.012, 0.02), 0.0)
    veins = 0.5 + 0.5 * np.cos(2 * np.pi * (7.0 * share - 9.0 * np.abs(across)))
    # One half of the blade faces the light more than the other.
    light = leaf.tone * (1.0 + 0.10 * np.tanh(12.0 * across)) * (0.90 + 0.08 * veins)
    light = light + 0.10 * np.exp(-((across / 0.018) ** 2)) * (share > 0)
    hue = np.array([1.0 + 0.14 * leaf.yellow, 1.0 + 0.03 * leaf.yellow, 1.0 - 0.18 * leaf.yellow]) * (0.92, 0.95, 0.85)
    return np.clip(light[..., None] * hue, 0.0, 1.0), inside, shade


def _texels(colour: Float64Array, alpha: Float64Array) -> UInt8Array:
    """Samples (n, n, 3) with their alpha multiplied in, and alpha, as texels; gaps have the leaves' mean colour."""
    whole = np.concatenate([colour, alpha[..., None]], axis=-1)
    size = len(whole) // _FINE
    mean = whole.reshape(size, _FINE, size, _FINE, 4).mean(axis=(1, 3))
    usual = mean[..., :3].sum(axis=(0, 1)) / mean[..., 3].sum()
    shown = np.where(mean[..., 3:] > 0.02, mean[..., :3] / np.maximum(mean[..., 3:], 0.02), usual)
    return (255 * np.concatenate([shown, mean[..., 3:]], axis=-1) + 0.5).astype(np.uint8)


def _ramp(value: Float64Array, width: float) -> Float64Array:
    """Linear ramp: 0 below zero, 1 a width above it."""
    return np.asarray(np.clip(value / width + 0.5, 0.0, 1.0))
