"""Reproducible noise: periodic tables over the world's plane and along its streets."""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Final

import numpy as np

from pavetwin._core import raster_looked_up
from pavetwin.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pavetwin.scene.texture_cache import kept
from pavetwin.seeds import Stream, child

_PX: Final = 1024
_PLANE_STEP_M: Final = 0.0625
_ALONG_STEP_M: Final = 0.25
_ACROSS_STEP_M: Final = 0.03125
_ACROSS_PX: Final = 512
_LINE_PX: Final = 8192
_RAGGED_STEP_M: Final = 0.02
_LASTING_STEP_M: Final = 0.10


@dataclass(frozen=True)
class NoiseTables:
    """Tables of mean 0 and deviation 1."""

    broad: Float32Array
    """Over the plane, features of 1.5 to 6 m."""
    blotch: Float32Array
    """Over the plane, features of 0.25 to 1 m."""
    fine: Float32Array
    """Over the plane, features of about 0.1 m."""
    streak: Float32Array
    """(_PX along, _ACROSS_PX across) a street: long and narrow."""
    band: Float32Array
    """The same, broader: marks of rollers and wheels."""
    scuff: Float32Array
    """The same, narrower and shorter: single tyres' marks."""
    ragged: Float32Array
    """(_LINE_PX,) along a line: edges of what is poured or brushed, features of about 0.1 m."""
    lasting: Float32Array
    """(_LINE_PX,) along a line: its remaining share, features of metres."""

    def plane(self, table: Float32Array, x: Float64Array, y: Float64Array, *, turn: int = 0) -> Float32Array:
        """A table over columns at world x and rows at world y, (rows, columns); `turn` takes another part of it."""
        columns = (np.floor(x / _PLANE_STEP_M).astype(np.int64) + 389 * turn) % _PX
        rows = (np.floor(y / _PLANE_STEP_M).astype(np.int64) + 613 * turn) % _PX
        return raster_looked_up(table, rows.astype(np.uint32), columns.astype(np.uint32))

    def road(
        self, tables: tuple[Float32Array, ...], along: Float32Array, across: Float32Array, offset: Int32Array
    ) -> list[Float32Array]:
        """Tables along a street, (...) each; `offset` selects the street. Sides of the tables are powers of two."""
        rows = (np.floor(along * np.float32(1 / _ALONG_STEP_M)).astype(np.int32) + offset) & (_PX - 1)
        columns = np.floor(across * np.float32(1 / _ACROSS_STEP_M)).astype(np.int32) + offset // 7
        at = rows * np.int32(_ACROSS_PX) + (columns & (_ACROSS_PX - 1))
        return [table.reshape(-1).take(at) for table in tables]

    def edge(self, along: Float32Array, offset: Int64Array) -> Float32Array:
        """Offset of an edge at stations along it, (...); `offset` selects the edge."""
        return np.asarray(self.ragged[(np.floor(along / _RAGGED_STEP_M).astype(np.int64) + 619 * offset) % _LINE_PX])

    def kept(self, along: Float32Array, offset: Int64Array) -> Float32Array:
        """Remaining share of a line at stations along it, (...), piecewise linear; `offset` selects the line."""
        at = along / _LASTING_STEP_M
        low = np.floor(at).astype(np.int64)
        share = (at - low).astype(np.float32)
        first, second = (self.lasting[(low + step + 911 * offset) % _LINE_PX] for step in (0, 1))
        return np.asarray(first + (second - first) * share)


@lru_cache(maxsize=4)
def noise_tables(seed: int) -> NoiseTables:
    """The tables of a seed."""
    return NoiseTables(**kept("noise", partial(_tables, seed), seed))


def _tables(seed: int) -> dict[str, Float32Array]:
    """Tables, keyed by the fields of `NoiseTables`."""
    rng = child(seed, Stream.SCENE, 1)
    step = _PLANE_STEP_M
    return {
        "broad": _waves(rng, (_PX, _PX), (3.0 / step, 3.0 / step), 1.2),
        "blotch": _waves(rng, (_PX, _PX), (0.55 / step, 0.55 / step), 1.1),
        "fine": _waves(rng, (_PX, _PX), (0.16 / step, 0.16 / step), 0.7),
        "streak": _waves(rng, (_PX, _ACROSS_PX), (11.0 / _ALONG_STEP_M, 0.30 / _ACROSS_STEP_M), 1.0),
        "band": _waves(rng, (_PX, _ACROSS_PX), (28.0 / _ALONG_STEP_M, 0.95 / _ACROSS_STEP_M), 0.8),
        "scuff": _waves(rng, (_PX, _ACROSS_PX), (3.5 / _ALONG_STEP_M, 0.14 / _ACROSS_STEP_M), 0.8),
        "ragged": _waves(rng, (1, _LINE_PX), (1.0, 0.22 / _RAGGED_STEP_M), 1.5)[0],
        "lasting": _waves(rng, (1, _LINE_PX), (1.0, 5.0 / _LASTING_STEP_M), 1.1)[0],
    }


def _waves(
    rng: np.random.Generator, shape: tuple[int, int], wavelength_px: tuple[float, float], octaves: float
) -> Float32Array:
    """Smooth periodic noise with its own wavelength along each axis."""
    spectrum = np.fft.rfft2(rng.standard_normal(shape))
    fy = np.fft.fftfreq(shape[0])[:, None] * wavelength_px[0]
    fx = np.fft.rfftfreq(shape[1])[None, :] * wavelength_px[1]
    frequency = np.hypot(fx, fy)
    octave = np.log2(np.maximum(frequency, 1e-6))
    spectrum *= np.exp(-0.5 * (octave / octaves) ** 2) / np.maximum(frequency, 1e-3)
    spectrum[0, 0] = 0
    waves = np.fft.irfft2(spectrum, s=shape)
    return np.asarray(waves / waves.std(), dtype=np.float32)
