"""Tools to draw façade textures in NumPy: tileable noise, and rectangles with antialiased edges in a cell."""

from dataclasses import dataclass, field

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.scene.buildings.layers import FACADE_PX
from pavetwin.scene.palettes import Colour


def noise(rng: np.random.Generator, wavelength_px: float, *, along: float = 1.0, size: int = FACADE_PX) -> Float32Array:
    """Smooth periodic noise (size, size), mean 0 and deviation 1; `along` above 1 stretches it along rows."""
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    fx = np.fft.rfftfreq(size)[None, :] * along
    fy = np.fft.fftfreq(size)[:, None]
    spectrum *= np.exp(-0.5 * (np.hypot(fx, fy) * wavelength_px) ** 2)
    spectrum[0, 0] = 0
    waves = np.fft.irfft2(spectrum, s=(size, size))
    return np.asarray(waves / waves.std(), dtype=np.float32)


def fractal(rng: np.random.Generator, coarsest_px: float, *, octaves: int = 5, along: float = 1.0) -> Float32Array:
    """Noise over several octaves, each half as strong as the coarser one; deviation about 1."""
    parts = [0.5**k * noise(rng, coarsest_px / 2**k, along=along) for k in range(octaves)]
    return np.asarray(sum(parts) / np.sqrt(sum(0.25**k for k in range(octaves))), dtype=np.float32)


def grid() -> tuple[Float32Array, Float32Array]:
    """Columns and rows of the texels' middles, each (FACADE_PX, FACADE_PX)."""
    rows, columns = np.meshgrid(np.arange(FACADE_PX) + 0.5, np.arange(FACADE_PX) + 0.5, indexing="ij")
    return columns.astype(np.float32), rows.astype(np.float32)


def layer_of(reflectance: Float32Array, roughness: Float32Array | float) -> Float32Array:
    """(k, k, 4) linear from (k, k) or (k, k, 3) reflectance and a roughness."""
    size = reflectance.shape[0]
    colours = reflectance if reflectance.ndim == 3 else np.repeat(reflectance[..., None], 3, axis=2)
    rough = np.broadcast_to(np.asarray(roughness, dtype=np.float32), (size, size))
    return np.concatenate([np.clip(colours, 0, 1), rough[..., None]], axis=2).astype(np.float32)


@dataclass
class TextureCanvas:
    """A square canvas: x to the right and y up, both 0 … 1; row 0 is y = 0."""

    size: int
    pixels: Float32Array = field(init=False)
    """(size, size, 4) linear RGB and roughness."""

    def __post_init__(self) -> None:
        self.pixels = np.zeros((self.size, self.size, 4), dtype=np.float32)
        at = (np.arange(self.size, dtype=np.float32) + 0.5) / self.size
        self.x, self.y = np.meshgrid(at, at)

    def rectangle(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        colour: Colour | Float32Array,
        roughness: float,
        *,
        opacity: float | Float32Array = 1.0,
    ) -> None:
        """Paint a rectangle whose edges are a texel soft. `colour` is one colour or (size, size, 3)."""
        soft = 1.0 / self.size
        inside = np.minimum(np.minimum(self.x - x[0], x[1] - self.x), np.minimum(self.y - y[0], y[1] - self.y))
        share = (np.clip(inside / soft + 0.5, 0, 1) * opacity)[..., None]
        paint = np.concatenate(
            [
                np.broadcast_to(np.asarray(colour, dtype=np.float32), (self.size, self.size, 3)),
                np.full((self.size, self.size, 1), roughness, dtype=np.float32),
            ],
            axis=2,
        )
        self.pixels = (self.pixels * (1 - share) + paint * share).astype(np.float32)

    def frame(
        self, x: tuple[float, float], y: tuple[float, float], width: float, colour: Colour, roughness: float
    ) -> None:
        """Four bars along the inside of a rectangle, lit from above: the lower one brighter, the upper one darker."""
        shade: Colour = (colour[0] * 0.8, colour[1] * 0.8, colour[2] * 0.8)
        self.rectangle((x[0], x[0] + width), y, colour, roughness)
        self.rectangle((x[1] - width, x[1]), y, colour, roughness)
        self.rectangle(x, (y[1] - width, y[1]), shade, roughness)
        self.rectangle(x, (y[0], y[0] + width), colour, roughness)
