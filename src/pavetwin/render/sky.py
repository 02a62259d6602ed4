"""The sky as an environment map for reflections."""

from typing import Final

import numpy as np

from pavetwin.arrays import Float16Array
from pavetwin.scene.light import Light

ROWS: Final = 64
COLUMNS: Final = 128


def sky_levels(light: Light) -> list[Float16Array]:
    """Luminances (rows, columns, 4) in kcd/m², from the zenith in row 0 to the nadir, columns anticlockwise from west;
    and smaller ones, blurred for rougher surfaces. Below the horizon lies the light reflected by the ground."""
    down = (np.arange(ROWS) + 0.5) / ROWS * np.pi
    around = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * 2 * np.pi
    polar, turn = np.meshgrid(down, around, indexing="ij")
    directions = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    radiance = np.where(directions[..., 2:] >= 0, light.sky(directions), light.ground_radiance)
    levels = [radiance]
    while levels[-1].shape[0] > 2:
        fine = levels[-1]
        levels.append(fine.reshape(fine.shape[0] // 2, 2, fine.shape[1] // 2, 2, 3).mean(axis=(1, 3)))
    return [np.concatenate([level, np.ones((*level.shape[:2], 1))], axis=-1).astype(np.float16) for level in levels]
