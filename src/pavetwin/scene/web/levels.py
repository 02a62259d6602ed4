"""The levels of detail of tiles for browsers."""

from dataclasses import dataclass
from typing import Final

from pavetwin.scene.buildings import HouseDetail
from pavetwin.scene.model import TILE_M

FORMAT: Final = 1
"""Of the manifest and the files; it changes with what a client must know to read them."""


@dataclass(frozen=True)
class WebLevel:
    """How finely the tiles of one level are made."""

    number: int
    """0 is the finest."""
    side: int
    """Of its squares, in tiles of the scene."""
    texel_m: float | None
    """Of the picture of its ground; None for a colour at each vertex."""
    houses: HouseDetail
    error_m: float
    """Greatest distance between the surfaces of its ground and houses and those of the finest level, without defects.
    Reveals and sills reach 0.3 m, equipment on flat roofs 1.4 m, and a hipped roof
    in wide steps loses less."""
    to_m: float
    """Nearer than this a client shows it; the coarsest is shown at any distance."""
    smallest_m: float
    """Objects whose second largest dimension is less are left out."""

    @property
    def side_m(self) -> float:
        return self.side * TILE_M


WEB_LEVELS: Final = (
    WebLevel(0, 1, 0.0625, HouseDetail.FULL, 0.0, 55.0, 0.0),
    WebLevel(1, 1, 0.25, HouseDetail.FLAT, 0.5, 150.0, 0.1),
    WebLevel(2, 2, None, HouseDetail.BLANK, 1.6, float("inf"), 1.5),
)

DEFECTS_A_PART: Final = 3
"""Reliefs of defects in one file: each takes a tenth of a second or more."""

DEFECT_TEXEL_M: Final = 0.012
"""Of the pictures of defects."""

DEFECTS_TO_M: Final = 40.0
"""Nearer than this a client shows the relief of defects in place of the picture of the ground."""

MODEL_TRIANGLES: Final = (2600, 460, 90)
CROWN_TRIANGLES: Final = (1800, 450, 220)
"""Most triangles of a part of a model at each level, and of a crown of leaves."""
