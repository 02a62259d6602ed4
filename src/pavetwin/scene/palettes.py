"""Colour palettes: paint of vehicles, clothes, hair and skin of people. All are linear RGB reflectances.

Shares are of the choice among the entries; where they have a source it is named.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

Colour = tuple[float, float, float]
"""Red, green and blue: linear reflectance, or a factor of one."""


@dataclass(frozen=True, slots=True)
class Tone:
    """A colour family: its mean, and the variation of lightness (a factor, ± one standard deviation)."""

    share: float
    colour: Colour
    spread: float = 0.1


PAINTS: Final[tuple[Tone, ...]] = (
    Tone(0.38, (0.72, 0.72, 0.70), 0.06),  # white
    Tone(0.19, (0.010, 0.010, 0.011), 0.25),  # black
    Tone(0.15, (0.085, 0.088, 0.092), 0.35),  # grey
    Tone(0.09, (0.42, 0.43, 0.44), 0.12),  # silver
    Tone(0.05, (0.017, 0.038, 0.11), 0.35),  # dark blue
    Tone(0.02, (0.10, 0.18, 0.31), 0.25),  # light blue
    Tone(0.05, (0.32, 0.014, 0.014), 0.3),  # red
    Tone(0.03, (0.16, 0.115, 0.075), 0.35),  # brown, beige
    Tone(0.02, (0.03, 0.075, 0.045), 0.35),  # green
    Tone(0.02, (0.55, 0.28, 0.03), 0.2),  # yellow, orange
)
"""Cars. Shares: Axalta, Global Automotive Color Popularity Report 2020: white 38 %, black 19, grey 15, silver 9,
blue 7, red 5, brown and beige 3; the rest is shared out here. Reflectances: ours."""

WORK_PAINTS: Final[tuple[Tone, ...]] = (
    Tone(0.62, (0.72, 0.72, 0.70), 0.05),
    Tone(0.10, (0.015, 0.045, 0.16), 0.3),
    Tone(0.09, (0.32, 0.014, 0.014), 0.25),
    Tone(0.07, (0.55, 0.30, 0.03), 0.15),
    Tone(0.06, (0.085, 0.088, 0.092), 0.3),
    Tone(0.06, (0.03, 0.10, 0.05), 0.3),
)
"""Lorries and vans of firms: mostly white. Ours."""

BUS_PAINTS: Final[tuple[Tone, ...]] = (
    Tone(0.35, (0.62, 0.60, 0.54), 0.06),
    Tone(0.30, (0.40, 0.018, 0.016), 0.15),
    Tone(0.20, (0.02, 0.07, 0.24), 0.2),
    Tone(0.15, (0.52, 0.34, 0.03), 0.1),
)
"""Town buses wear the livery of their operator. Ours."""

TOPS: Final[tuple[Tone, ...]] = (
    Tone(0.22, (0.020, 0.020, 0.022), 0.4),  # black
    Tone(0.15, (0.022, 0.030, 0.060), 0.4),  # navy
    Tone(0.15, (0.11, 0.11, 0.115), 0.4),  # grey
    Tone(0.17, (0.62, 0.61, 0.58), 0.15),  # white
    Tone(0.08, (0.10, 0.17, 0.30), 0.3),  # light blue
    Tone(0.07, (0.26, 0.030, 0.030), 0.3),  # red
    Tone(0.06, (0.060, 0.075, 0.035), 0.3),  # olive
    Tone(0.05, (0.25, 0.18, 0.11), 0.3),  # beige
    Tone(0.03, (0.50, 0.32, 0.05), 0.2),  # yellow
    Tone(0.02, (0.35, 0.10, 0.16), 0.3),  # pink
)
BOTTOMS: Final[tuple[Tone, ...]] = (
    Tone(0.34, (0.030, 0.045, 0.090), 0.45),  # jeans
    Tone(0.30, (0.018, 0.018, 0.020), 0.4),  # black
    Tone(0.14, (0.08, 0.08, 0.085), 0.4),  # grey
    Tone(0.14, (0.22, 0.17, 0.11), 0.3),  # beige
    Tone(0.08, (0.50, 0.49, 0.46), 0.2),  # light
)
"""Clothes: ours, after photographs of streets."""

HAIR: Final[tuple[Tone, ...]] = (
    Tone(0.40, (0.35, 0.33, 0.33), 0.3),
    Tone(0.33, (1.0, 1.0, 1.0), 0.3),
    Tone(0.15, (4.5, 4.2, 3.2), 0.3),
    Tone(0.12, (9.0, 12.0, 16.0), 0.2),
)
"""Factors on the models' dark brown: black, brown, fair, grey. Ours."""

SKIN: Final[tuple[Tone, ...]] = (
    Tone(0.45, (1.15, 1.2, 1.25), 0.08),
    Tone(0.30, (0.85, 0.80, 0.72), 0.12),
    Tone(0.15, (0.50, 0.42, 0.35), 0.15),
    Tone(0.10, (0.20, 0.15, 0.12), 0.2),
)
"""Factors on the models' skin, light to dark. Ours."""


def drawn(palette: tuple[Tone, ...], rng: np.random.Generator) -> Colour:
    """One individual's colour."""
    shares = np.array([tone.share for tone in palette])
    tone = palette[int(rng.choice(len(palette), p=shares / shares.sum()))]
    factor = float(np.exp(tone.spread * np.clip(rng.standard_normal(), -2, 2)))
    red, green, blue = tone.colour
    return red * factor, green * factor, blue * factor
