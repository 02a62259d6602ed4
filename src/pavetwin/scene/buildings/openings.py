"""Textures of openings: sixteen windows, sixteen large glazings, sixteen doors and gates, one cell each.

Windows vary in curtains, blinds, dark rooms, plants and tilted sashes, as real ones do. Daylight is far brighter than
rooms, so only shops show lit interiors.
"""

from collections.abc import Callable

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.scene.buildings.layers import CELLS, FACADE_PX
from pavetwin.scene.buildings.pixels import TextureCanvas
from pavetwin.scene.palettes import Colour

CELL_PX = FACADE_PX // CELLS
WHITE: Colour = (0.66, 0.66, 0.64)
ANTHRACITE: Colour = (0.035, 0.037, 0.040)
WOOD: Colour = (0.13, 0.070, 0.035)
GLASS_ROUGH = 0.04
Painter = Callable[[np.random.Generator, int], TextureCanvas]


def windows(rng: np.random.Generator) -> Float32Array:
    """(k, k, 4): cells 0 … 7 have white frames, 8 … 11 dark, 12 … 15 wooden ones."""
    return _atlas(rng, _window)


def glazing(rng: np.random.Generator) -> Float32Array:
    """(k, k, 4): cells 0 … 7 are panes of offices, 8 … 15 shop windows."""
    return _atlas(rng, lambda own, number: _office(own) if number < 8 else _shop(own))


def doors(rng: np.random.Generator) -> Float32Array:
    """(k, k, 4): cells 0 … 7 are house doors, 8 … 11 garage doors, 12 … 15 roller shutters."""
    return _atlas(rng, _door)


def _atlas(rng: np.random.Generator, paint: Painter) -> Float32Array:
    cells = [paint(own, number).pixels for number, own in enumerate(rng.spawn(CELLS * CELLS))]
    rows = [np.concatenate(cells[row * CELLS : (row + 1) * CELLS], axis=1) for row in range(CELLS)]
    return np.concatenate(rows, axis=0)


def _room(cell: TextureCanvas, rng: np.random.Generator) -> None:
    """The dark of a room, a little lighter towards the sill."""
    depth = 0.016 + 0.020 * (1 - cell.y) ** 2 * rng.uniform(0.3, 1.4)
    tint = np.array([1.0, 1.03, 1.08], dtype=np.float32) * depth[..., None]
    cell.rectangle((-1, 2), (-1, 2), tint.astype(np.float32), GLASS_ROUGH)


def _window(rng: np.random.Generator, number: int) -> TextureCanvas:
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
