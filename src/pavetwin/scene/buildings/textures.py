"""Façade textures: walls and roofs that repeat, openings in cells, and all of them as one array."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pavetwin.arrays import Float32Array, UInt8Array
from pavetwin.scene.buildings.layers import CELLS, FACADE_PX, FACADE_REPEAT_M, FacadeTexture
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.palettes import Colour
from pavetwin.scene.texture_cache import kept
from pavetwin.seeds import Stream, child


def noise(rng: np.random.Generator, wavelength_px: float, *, along: float = 1.0) -> Float32Array:
    """Smooth periodic noise (FACADE_PX, FACADE_PX), mean 0 and deviation 1; `along` above 1 stretches it along rows."""
    spectrum = np.fft.rfft2(rng.standard_normal((FACADE_PX, FACADE_PX), dtype=np.float32))
    fx, fy = np.fft.rfftfreq(FACADE_PX)[None, :] * along, np.fft.fftfreq(FACADE_PX)[:, None]
    spectrum *= np.exp(-0.5 * (np.hypot(fx, fy) * wavelength_px) ** 2)
    spectrum[0, 0] = 0
    waves = np.fft.irfft2(spectrum, s=(FACADE_PX, FACADE_PX))
    return np.asarray(waves / waves.std(), dtype=np.float32)


def fractal(rng: np.random.Generator, coarsest_px: float, *, along: float = 1.0) -> Float32Array:
    """Noise over five octaves, each half as strong as the coarser one; deviation about 1."""
    parts = [0.5**k * noise(rng, coarsest_px / 2**k, along=along) for k in range(5)]
    return np.asarray(sum(parts) / np.sqrt(sum(0.25**k for k in range(5))), dtype=np.float32)


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
    pixels: Float32Array = field(init=False)  # (size, size, 4) linear RGB and roughness

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


CELL_PX = FACADE_PX // CELLS
WHITE: Colour = (0.66, 0.66, 0.64)
ANTHRACITE: Colour = (0.035, 0.037, 0.040)
WOOD: Colour = (0.13, 0.070, 0.035)
GLASS_ROUGH = 0.04
Painter = Callable[[np.random.Generator, int], TextureCanvas]


def _atlas(paint: Painter, rng: np.random.Generator) -> Float32Array:
    """(k, k, 4) of all cells."""
    cells = [paint(own, number).pixels for number, own in enumerate(rng.spawn(CELLS * CELLS))]
    rows = [np.concatenate(cells[row * CELLS : (row + 1) * CELLS], axis=1) for row in range(CELLS)]
    return np.concatenate(rows, axis=0)


def _room(cell: TextureCanvas, rng: np.random.Generator) -> None:
    """The dark of a room, a little lighter towards the sill."""
    depth = 0.016 + 0.020 * (1 - cell.y) ** 2 * rng.uniform(0.3, 1.4)
    tint = np.array([1.0, 1.03, 1.08], dtype=np.float32) * depth[..., None]
    cell.rectangle((-1, 2), (-1, 2), tint.astype(np.float32), GLASS_ROUGH)


def _window(rng: np.random.Generator, number: int) -> TextureCanvas:
    """Cells 0 … 7 have white frames, 8 … 11 dark, 12 … 15 wooden ones."""
    cell = TextureCanvas(CELL_PX)
    _room(cell, rng)
    kind = rng.integers(6)
    if kind <= 1:
        _curtains(cell, rng, float(rng.uniform(0.14, 0.30)))
    elif kind == 2:
        _net_curtain(cell, rng)
    elif kind == 3:
        _blind(cell, rng, float(rng.uniform(0.25, 0.95)))
    elif kind == 4:
        _pots(cell, rng)
    frame = WHITE if number < 8 else ANTHRACITE if number < 12 else WOOD
    cell.frame((0, 1), (0, 1), 0.055, frame, 0.5)
    sashes = 1 if number % 4 == 3 else 2
    for sash in range(sashes):
        left, right = 0.05 + sash * 0.9 / sashes, 0.05 + (sash + 1) * 0.9 / sashes
        cell.frame((left, right), (0.05, 0.95), 0.042, frame, 0.5)
        cell.frame((left + 0.042, right - 0.042), (0.092, 0.908), 0.008, (0.02, 0.02, 0.02), 0.6)
    if number % 4 == 2:
        cell.rectangle((0.05, 0.95), (0.68, 0.735), frame, 0.5)
    return cell


def _curtains(cell: TextureCanvas, rng: np.random.Generator, width: float) -> None:
    tone = float(rng.uniform(0.18, 0.5))
    tint = np.array([1.0, rng.uniform(0.85, 1.0), rng.uniform(0.65, 0.95)], dtype=np.float32)
    folds = tone * (0.8 + 0.2 * np.sin(cell.x * rng.uniform(90, 140) + 2 * np.sin(cell.y * 3)))
    cloth = (folds[..., None] * tint).astype(np.float32)
    cell.rectangle((0, width), (0, 1), cloth, 0.35)
    cell.rectangle((1 - width * float(rng.uniform(0.7, 1.2)), 1), (0, 1), cloth, 0.35)


def _net_curtain(cell: TextureCanvas, rng: np.random.Generator) -> None:
    folds = 0.34 + 0.05 * np.sin(cell.x * rng.uniform(60, 110) + 1.5 * np.sin(cell.y * 5))
    lower = float(rng.choice([0.0, 0.0, 0.35]))
    cloth = np.repeat(folds[..., None], 3, axis=2).astype(np.float32)
    cell.rectangle((0, 1), (lower, 1), cloth, 0.3, opacity=0.75)


def _blind(cell: TextureCanvas, rng: np.random.Generator, down: float) -> None:
    slats = 0.38 + 0.07 * np.sign(np.sin(cell.y * 150))
    tint = np.array([1.0, 0.98, rng.uniform(0.82, 0.98)], dtype=np.float32)
    cell.rectangle((0, 1), (1 - down, 1), (slats[..., None] * tint).astype(np.float32), 0.4)


def _pots(cell: TextureCanvas, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(2, 5))):
        x, high = float(rng.uniform(0.15, 0.8)), float(rng.uniform(0.12, 0.3))
        cell.rectangle((x - 0.03, x + 0.03), (0.05, 0.14), (0.2, 0.09, 0.05), 0.7)
        cell.rectangle((x - 0.07, x + 0.07), (0.14, 0.14 + high), (0.03, 0.07, 0.02), 0.7, opacity=0.8)


def _glazing(rng: np.random.Generator, number: int) -> TextureCanvas:
    """Cells 0 … 7 are panes of offices, 8 … 15 shop windows."""
    return _office(rng) if number < 8 else _shop(rng)


def _office(rng: np.random.Generator) -> TextureCanvas:
    cell = TextureCanvas(CELL_PX)
    base = np.array([0.018, 0.026, 0.032], dtype=np.float32) * float(rng.uniform(0.8, 1.5))
    cell.rectangle((-1, 2), (-1, 2), np.broadcast_to(base, (CELL_PX, CELL_PX, 3)), 0.03)
    if rng.random() < 0.5:
        _blind(cell, rng, float(rng.uniform(0.15, 0.8)))
    if rng.random() < 0.6:  # ceiling lamps, faintly visible
        for y in (0.8, 0.88):
            cell.rectangle((0.2, 0.8), (y, y + 0.02), (0.30, 0.30, 0.28), GLASS_ROUGH)
    cell.frame((0, 1), (0, 1), 0.03, (0.10, 0.105, 0.11), 0.4)
    return cell


def _shop(rng: np.random.Generator) -> TextureCanvas:
    cell = TextureCanvas(CELL_PX)
    _room(cell, rng)
    warm = np.array([1.0, 0.85, 0.6], dtype=np.float32) * 0.055
    glow = np.exp(-((cell.y - 0.55) ** 2) / 0.06)[..., None] * warm
    cell.pixels[..., :3] += glow.astype(np.float32)
    for _ in range(int(rng.integers(4, 9))):  # shop display
        x, wide, high = float(rng.uniform(0.05, 0.9)), float(rng.uniform(0.04, 0.14)), float(rng.uniform(0.1, 0.45))
        tone = float(rng.uniform(0.05, 0.32))
        red, green, blue = (tone * float(value) for value in rng.uniform(0.65, 1.1, 3))
        cell.rectangle((x, x + wide), (0.05, 0.05 + high), (red, green, blue), 0.3, opacity=0.85)
    if rng.random() < 0.4:  # a poster or lettering on the pane
        x = float(rng.uniform(0.1, 0.5))
        cell.rectangle((x, x + 0.3), (0.45, 0.75), (0.55, 0.5, 0.42), 0.3, opacity=0.8)
    dark: Colour = (0.05, 0.05, 0.055)
    cell.frame((0, 1), (0, 1), 0.025, dark, 0.4)
    cell.rectangle((0, 1), (0.0, 0.05), dark, 0.5)
    return cell


def _door(rng: np.random.Generator, number: int) -> TextureCanvas:
    """Cells 0 … 7 are house doors, 8 … 11 garage doors, 12 … 15 roller shutters."""
    if number >= 8:
        return _gate(rng, shutter=number >= 12)
    cell = TextureCanvas(CELL_PX)
    palette: tuple[Colour, ...] = (WOOD, (0.05, 0.09, 0.06), (0.18, 0.03, 0.025), ANTHRACITE, (0.5, 0.5, 0.48))
    colour = palette[int(rng.integers(len(palette)))]
    light: Colour = (min(1.0, colour[0] * 1.3), min(1.0, colour[1] * 1.3), min(1.0, colour[2] * 1.3))
    cell.rectangle((-1, 2), (-1, 2), colour, 0.45)
    if number % 2:  # with panes
        cell.rectangle((0.2, 0.8), (0.5, 0.92), (0.02, 0.023, 0.026), GLASS_ROUGH)
        cell.frame((0.2, 0.8), (0.5, 0.92), 0.03, light, 0.45)
    else:
        for low, high in ((0.08, 0.42), (0.5, 0.92)):
            for left, right in ((0.15, 0.47), (0.53, 0.85)):
                cell.frame((left, right), (low, high), 0.03, light, 0.45)
    cell.rectangle((0.84, 0.9), (0.44, 0.47), (0.4, 0.39, 0.36), 0.3)
    cell.frame((0, 1), (-0.1, 1), 0.06, WHITE if number < 4 else light, 0.5)
    cell.rectangle((0, 1), (0, 0.02), (0.12, 0.12, 0.12), 0.8)
    return cell


def _gate(rng: np.random.Generator, *, shutter: bool) -> TextureCanvas:
    cell = TextureCanvas(CELL_PX)
    tone = float(rng.choice([0.55, 0.35, 0.12]))
    lines = 24 if shutter else 4
    face = tone * (0.88 + 0.12 * np.clip(np.sin(cell.y * lines * 2 * np.pi) * 3, -1, 1))
    cell.rectangle((-1, 2), (-1, 2), np.repeat(face[..., None], 3, axis=2).astype(np.float32), 0.5)
    if not shutter and rng.random() < 0.5:
        for pane in range(4):
            x = 0.08 + 0.22 * pane
            cell.rectangle((x, x + 0.18), (0.8, 0.92), (0.03, 0.034, 0.038), GLASS_ROUGH)
    cell.frame((0, 1), (-0.1, 1), 0.03, (0.3, 0.3, 0.3), 0.5)
    return cell


PX_A_METRE = FACADE_PX / FACADE_REPEAT_M


def render(rng: np.random.Generator) -> Float32Array:
    """Painted plaster: fine grain, clouds of dirt, streaks where rain runs."""
    grain, clouds = noise(rng, 2.0), fractal(rng, 160.0)
    streaks = np.clip(noise(rng, 90.0, along=0.07), 0, None) * np.clip(0.5 + 0.5 * noise(rng, 120.0), 0, 1)
    return layer_of(0.86 + 0.018 * grain + 0.022 * clouds - 0.030 * streaks, 0.93)


def brick(rng: np.random.Generator) -> Float32Array:
    """Stretcher bond, 25.6 × 8 cm with joints of a centimetre; every brick its own tone."""
    columns, rows = grid()
    across, courses = 25, 80
    course = np.floor(rows / FACADE_PX * courses).astype(int)
    along = columns / FACADE_PX * across + 0.5 * (course % 2)
    number = np.floor(along).astype(int) % across
    tone = rng.normal(1.0, 0.13, (courses, across)).astype(np.float32)[course, number]
    hue = rng.normal(0.0, 0.05, (courses, across)).astype(np.float32)[course, number]
    joint_x = np.abs((along % 1.0) - 0.5) * 2
    joint_y = np.abs((rows / FACADE_PX * courses) % 1.0 - 0.5) * 2
    joint = np.clip(np.maximum((joint_x - 0.95) / 0.05, (joint_y - 0.80) / 0.2) * 1.6, 0, 1)
    face = tone + 0.05 * noise(rng, 2.0) + 0.04 * fractal(rng, 140.0)
    colours = np.stack([face * (1 + hue), face, face * (1 - hue)], axis=2) * np.array([0.30, 0.125, 0.080])
    mortar = np.array([0.36, 0.34, 0.31], dtype=np.float32)
    return layer_of((colours * (1 - joint[..., None]) + mortar * joint[..., None]).astype(np.float32), 0.92)


def concrete(rng: np.random.Generator) -> Float32Array:
    """Panels of 3.2 m with sealed joints and tie holes, stained downwards."""
    columns, rows = grid()
    x, y = columns / PX_A_METRE % 3.2, rows / PX_A_METRE % 3.2
    edge = np.minimum(np.minimum(x, 3.2 - x), np.minimum(y, 3.2 - y))
    hole = np.hypot(np.abs(x - 1.6) - 0.8, np.abs(y - 1.6) - 0.8)
    streaks = np.clip(noise(rng, 100.0, along=0.05), 0, None)
    face = 0.82 + 0.03 * fractal(rng, 120.0) + 0.02 * noise(rng, 2.0) - 0.05 * streaks
    face = face * (1 - 0.55 * np.clip(1 - edge / 0.018, 0, 1)) * (1 - 0.5 * np.clip(1.5 - hole / 0.02, 0, 1))
    which = (rows / PX_A_METRE // 3.2).astype(int), (columns / PX_A_METRE // 3.2).astype(int)
    panel = rng.normal(1.0, 0.03, (2, 2))[which]
    return layer_of((face * panel).astype(np.float32), 0.9)


def stone(rng: np.random.Generator) -> Float32Array:
    """Ashlar: courses of 40 cm, blocks of 80 cm, thin joints."""
    columns, rows = grid()
    course = np.floor(rows / PX_A_METRE / 0.4).astype(int)
    along = columns / PX_A_METRE / 0.8 + 0.5 * (course % 2)
    tone = rng.normal(1.0, 0.06, (16, 8))[course, np.floor(along).astype(int) % 8]
    joint = np.minimum(
        np.minimum(along % 1.0, 1 - along % 1.0) * 0.8, np.abs((rows / PX_A_METRE / 0.4 + 0.5) % 1.0 - 0.5) * 0.4
    )
    face = (0.80 + 0.05 * fractal(rng, 60.0) + 0.03 * noise(rng, 2.5)) * tone
    return layer_of((face * (1 - 0.4 * np.clip(1 - joint / 0.012, 0, 1))).astype(np.float32), 0.9)


def cladding(rng: np.random.Generator) -> Float32Array:
    """Trapezoidal steel sheet, ribs every 20 cm, upright."""
    columns, _ = grid()
    rib = columns / PX_A_METRE / 0.2 % 1.0
    lit = 0.84 + 0.10 * np.clip(np.sin(2 * np.pi * rib) * 2, -1, 1) * (np.abs(rib - 0.5) > 0.15)
    return layer_of((lit + 0.015 * fractal(rng, 160.0, along=0.3)).astype(np.float32), 0.5)


def tiles(rng: np.random.Generator) -> Float32Array:
    """Clay pantiles 20 cm wide in rows of 32 cm: each course's lower edge casts a shadow. v runs up the roof."""
    columns, rows = grid()
    course = np.floor(rows / PX_A_METRE / 0.32).astype(int)
    up = rows / PX_A_METRE / 0.32 % 1.0
    along = columns / PX_A_METRE / 0.2
    number = np.floor(along).astype(int) % 32
    tone = rng.normal(1.0, 0.12, (20, 32))[course, number]
    wave = 0.82 + 0.22 * np.sin(2 * np.pi * (along % 1.0))
    shadow = 1 - 0.55 * np.clip(1 - up / 0.16, 0, 1)
    moss = np.clip(0.6 * fractal(rng, 130.0) - 0.8, 0, 0.7)
    face = (tone * wave * shadow * (1 + 0.06 * noise(rng, 3.0)))[..., None]
    clay = np.array([0.30, 0.105, 0.060])
    return layer_of((clay * face * (1 - moss[..., None] * np.array([0.55, 0.25, 0.3]))).astype(np.float32), 0.85)


def slate(rng: np.random.Generator) -> Float32Array:
    """Slates or concrete shingles 32 × 20 cm in broken bond, dark grey."""
    columns, rows = grid()
    course = np.floor(rows / PX_A_METRE / 0.2).astype(int)
    up = rows / PX_A_METRE / 0.2 % 1.0
    along = columns / PX_A_METRE / 0.32 + 0.5 * (course % 2)
    tone = rng.normal(1.0, 0.14, (32, 20))[course, np.floor(along).astype(int) % 20]
    gap = np.clip(1 - np.minimum(along % 1.0, 1 - along % 1.0) / 0.03, 0, 1)
    shadow = (1 - 0.5 * np.clip(1 - up / 0.14, 0, 1)) * (1 - 0.5 * gap)
    face = (tone * shadow * (1 + 0.05 * noise(rng, 3.0) + 0.1 * fractal(rng, 150.0)))[..., None]
    return layer_of((np.array([0.075, 0.078, 0.085]) * face).astype(np.float32), 0.65)


def seams(rng: np.random.Generator) -> Float32Array:
    """Standing seams every 53 cm, weathered zinc."""
    columns, _ = grid()
    at = columns / FACADE_PX * 12 % 1.0
    seam = np.clip(1 - np.abs(at - 0.5) / 0.03, 0, 1)
    shadow = np.clip(1 - np.abs(at - 0.56) / 0.05, 0, 1)
    face = 0.34 + 0.02 * fractal(rng, 170.0, along=0.4) + 0.12 * seam - 0.14 * shadow
    return layer_of(np.asarray(face, dtype=np.float32), 0.45)


def gravel(rng: np.random.Generator) -> Float32Array:
    """Round gravel on a flat roof, with lichen and bare places."""
    grain = noise(rng, 2.2) * 0.6 + noise(rng, 4.0) * 0.4
    bare = np.clip(fractal(rng, 200.0) - 1.0, 0, 1)
    face = (0.26 + 0.085 * grain + 0.02 * fractal(rng, 150.0)) * (1 - 0.45 * bare)
    return layer_of((face[..., None] * np.array([1.04, 1.0, 0.93])).astype(np.float32), 0.95)


def felt(rng: np.random.Generator) -> Float32Array:
    """Bitumen sheets a metre wide, lapped, with dried puddles."""
    columns, _ = grid()
    lap = np.clip(1 - np.abs(columns / FACADE_PX * 6 % 1.0 - 0.5) / 0.012, 0, 1)
    puddles = np.abs(fractal(rng, 180.0))
    face = 0.085 + 0.012 * noise(rng, 2.0) + 0.02 * np.clip(1 - puddles / 0.3, 0, 1) - 0.035 * lap
    return layer_of(np.asarray(face, dtype=np.float32), 0.88)


KEY = 3  # Key of this module's child of the scene's random stream
MAKERS: Mapping[FacadeTexture, Callable[[np.random.Generator], Float32Array]] = {
    FacadeTexture.RENDER: render,
    FacadeTexture.BRICK: brick,
    FacadeTexture.CONCRETE: concrete,
    FacadeTexture.STONE: stone,
    FacadeTexture.CLADDING: cladding,
    FacadeTexture.TILES: tiles,
    FacadeTexture.SLATE: slate,
    FacadeTexture.SEAMS: seams,
    FacadeTexture.GRAVEL: gravel,
    FacadeTexture.FELT: felt,
    FacadeTexture.WINDOWS: partial(_atlas, _window),
    FacadeTexture.GLAZING: partial(_atlas, _glazing),
    FacadeTexture.DOORS: partial(_atlas, _door),
}


def facade_textures(seed: int) -> UInt8Array:
    """(layers, k, k, 4): sRGB-coded reflectance and roughness; row 0 is v = 0. From the cache."""
    return kept("facades", lambda: {"layers": _made(seed)}, seed)["layers"]


def _made(seed: int) -> UInt8Array:
    layers = []
    for layer in FacadeTexture:
        if layer is not FacadeTexture.PLAIN:
            drawn = MAKERS[layer](child(seed, Stream.SCENE, KEY, int(layer)))
            drawn[..., :3] = srgb_of_linear(drawn[..., :3])
            layers.append(np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8))
    return np.stack(layers)
