"""Textures of walls and roofs that repeat: render, brick, concrete, stone, cladding, tiles, slate, seams, gravel, felt.

Each maker draws (k, k, 4) linear reflectance and roughness. Walls but brick have a mean near 0.85, since the building's
colour multiplies them; brick and roof coverings carry their own colour.
"""

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.scene.buildings.layers import FACADE_PX, FACADE_REPEAT_M
from pavetwin.scene.buildings.pixels import fractal, grid, layer_of, noise

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
