"""Tools for tileable textures: noise, cells, stones, and maps derived from a height field."""

from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array, FloatArray
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.values import Detail

SIDE_PX: Final = 1024
"""Side of every detail texture [texels], so that they fit one array of a renderer."""


def noise(rng: np.random.Generator, wavelength_px: float, *, along: float = 1.0, octaves: float = 1.0) -> Float32Array:
    """Smooth periodic noise, (SIDE_PX, SIDE_PX), mean 0 and standard deviation 1.

    White noise under a log-normal band around a wavelength.

    Args:
        wavelength_px: of the strongest waves.
        along: above 1 stretched along the rows (u), below 1 along the columns.
        octaves: width of the band.
    """
    from scipy import fft  # a quarter of a second that textures from the cache need not wait

    spectrum = fft.rfft2(rng.standard_normal((SIDE_PX, SIDE_PX), dtype=np.float32))
    fx, fy = _frequencies()
    squared = np.maximum(fx**2 * np.float32(along) + fy**2 / np.float32(along), np.float32((0.5 / SIDE_PX) ** 2))
    # The logarithm of the square is twice that of the frequency.
    octave = 0.5 * np.log2(squared * np.float32(wavelength_px**2))
    spectrum *= np.exp(octave**2 * np.float32(-0.5 / octaves**2)) / np.sqrt(squared)
    spectrum[0, 0] = 0
    waves = fft.irfft2(spectrum, s=(SIDE_PX, SIDE_PX), overwrite_x=True)
    return np.asarray(waves / waves.std(), dtype=np.float32)


def _frequencies() -> tuple[Float32Array, Float32Array]:
    """Cycles a texel along u (1, n) and v (n, 1), as the transform orders them."""
    return np.fft.rfftfreq(SIDE_PX)[None, :].astype(np.float32), np.fft.fftfreq(SIDE_PX)[:, None].astype(np.float32)


def cells(rng: np.random.Generator, count: int, warp: Float32Array | None = None) -> tuple[Float32Array, Float32Array]:
    """Periodic Voronoi cells about a jittered grid of count² points.

    Args:
        count: cells along a side.
        warp: (SIDE_PX, SIDE_PX, 2) by how many texels the plane is bent first.

    Returns:
        The distance to the nearest border, roughly, in texels; and a number 0 … 1 of each cell.
    """
    points = rng.random((count, count, 2), dtype=np.float32)
    values = rng.random((count, count), dtype=np.float32)
    pitch = SIDE_PX / count
    rows, columns = np.meshgrid(np.arange(SIDE_PX), np.arange(SIDE_PX), indexing="ij")
    x, y = columns.astype(np.float32), rows.astype(np.float32)
    if warp is not None:
        x, y = x + warp[..., 0], y + warp[..., 1]
    x, y = (x / np.float32(pitch)).astype(np.float32), (y / np.float32(pitch)).astype(np.float32)
    i, j = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
    first = np.full((SIDE_PX, SIDE_PX), np.inf, dtype=np.float32)
    second, value = first.copy(), np.zeros_like(first)
    beyond_x, beyond_y = i - x, j - y
    for dj in (-1, 0, 1):
        row = (j + dj) % count * count
        for di in (-1, 0, 1):
            at = row + (i + di) % count
            dx = beyond_x + (di + points[..., 0]).ravel().take(at)
            dy = beyond_y + (dj + points[..., 1]).ravel().take(at)
            squared = dx * dx + dy * dy
            nearer = squared < first
            second = np.where(nearer, first, np.minimum(second, squared))
            np.copyto(value, values.ravel().take(at), where=nearer)
            np.minimum(first, squared, out=first)
    return (np.sqrt(second) - np.sqrt(first)) * np.float32(pitch / 2), value


def stones(
    rng: np.random.Generator, radii_px: Float32Array, depth: float = 1.0
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Angular stones scattered over the square; of overlapping ones the higher is visible.

    Args:
        radii_px: (n,) texels.
        depth: how much lower than the surface the tops of the deepest lie, in their height 0 … 1.

    Returns:
        The height 0 … 1 of the stone seen (0 for none), a number 0 … 1 of each stone, and how near its rim 0 … 1.
    """
    count = len(radii_px)
    centre = rng.random((count, 2), dtype=np.float32) * SIDE_PX
    turn = rng.random(count, dtype=np.float32) * np.float32(np.pi)
    aspect = 0.68 + 0.32 * rng.random(count, dtype=np.float32)
    power = 2.2 + 2.5 * rng.random(count, dtype=np.float32)
    top = 1.0 - depth * rng.random(count, dtype=np.float32) ** 1.5
    best = np.zeros(SIDE_PX * SIDE_PX, dtype=np.int64)
    reach = np.ceil(radii_px * 1.45).astype(np.int64)
    for half in np.unique(reach):
        chosen = np.flatnonzero(reach == half)
        span = np.arange(-half, half + 1)
        dy, dx = (grid.ravel() for grid in np.meshgrid(span, span, indexing="ij"))
        column, row = np.floor(centre[chosen, 0]).astype(np.int64), np.floor(centre[chosen, 1]).astype(np.int64)
        x = (column[:, None] + dx + 0.5 - centre[chosen, 0][:, None]) / radii_px[chosen][:, None]
        y = (row[:, None] + dy + 0.5 - centre[chosen, 1][:, None]) / radii_px[chosen][:, None]
        cos, sin = np.cos(turn[chosen])[:, None], np.sin(turn[chosen])[:, None]
        u, v = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x) / aspect[chosen][:, None]
        stone, texel = np.nonzero(np.maximum(u, v) < 1.0)  # powers cost most; a third of them matter
        p = power[chosen][stone]
        rim = (u[stone, texel] ** p + v[stone, texel] ** p) ** (1 / p)
        inside = rim < 1.0
        stone, texel, rim = stone[inside], texel[inside], rim[inside]
        height = top[chosen][stone] * (1.0 - 0.55 * rim * rim * rim)
        place = ((row[stone] + dy[texel]) % SIDE_PX) * SIDE_PX + (column[stone] + dx[texel]) % SIDE_PX
        packed = (height * 65535).astype(np.int64) << 40
        packed += (np.minimum(rim, 0.999) * 1023).astype(np.int64) << 30
        packed += chosen[stone] + 1
        np.maximum.at(best, place, packed)
    code = best.reshape(SIDE_PX, SIDE_PX)
    number = np.concatenate([[0.0], rng.random(count)]).astype(np.float32)
    height, edge = (code >> 40) / 65535, ((code >> 30) & 1023) / 1023
    return height.astype(np.float32), number[code & ((1 << 30) - 1)], edge.astype(np.float32)


def spread(field: Float32Array) -> Float32Array:
    """A field's ranks 0 … 1: the same order, evenly spread."""
    low, high = float(field.min()), float(field.max())
    level = ((field - low) * (65535 / max(high - low, 1e-9))).astype(np.int64)
    below = np.cumsum(np.bincount(level.ravel(), minlength=65536))
    return np.asarray(below[level] / field.size, dtype=np.float32)


def blurred(field: Float32Array, sigma_px: float) -> Float32Array:
    """A field under a periodic Gaussian."""
    from scipy import fft  # as above

    fx, fy = _frequencies()
    steep = np.float32(-2 * (np.pi * sigma_px) ** 2)
    filtered = fft.rfft2(field.astype(np.float32)) * (np.exp(steep * fx**2) * np.exp(steep * fy**2))
    return np.asarray(fft.irfft2(filtered, s=field.shape, overwrite_x=True), dtype=np.float32)


def float32(field: FloatArray) -> Float32Array:
    return np.asarray(field, dtype=np.float32)


def detail(
    size_m: float,
    albedo: Float32Array,
    height: Float32Array,
    roughness: Float32Array,
    hold: Float32Array,
    relief_m: float,
    mean: float,
) -> Detail:
    """Textures from fields.

    Args:
        size_m: the side they cover.
        albedo: (k, k, 3) linear reflectance up to a factor.
        height: (k, k) 0 … 1.
        roughness: (k, k) 0 … 1.
        hold: (k, k) order in which paint wears off, the lowest first.
        relief_m: what height 1 stands above height 0.
        mean: reflectance that the mean over the square and the colours is scaled to.
    """
    texel_m = size_m / SIDE_PX
    dx = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) * (relief_m / (2 * texel_m))
    dy = (np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)) * (relief_m / (2 * texel_m))
    length = np.sqrt(1 + dx**2 + dy**2)
    normal = np.stack([-dx / length, -dy / length], axis=-1)
    scaled = albedo * (mean / albedo.mean())
    coded = np.concatenate([srgb_of_linear(scaled), spread(hold)[..., None]], axis=-1)
    relief = np.concatenate([128 + 127 * normal, 255 * np.stack([height, roughness], axis=-1)], axis=-1)
    return Detail(
        size_m=size_m,
        reflectance=np.asarray(np.clip(coded * 255 + 0.5, 0, 255), dtype=np.uint8),
        relief=np.asarray(np.clip(relief + 0.5, 0, 255), dtype=np.uint8),
    )
