"""The layers of the façade textures: content and scale."""

from enum import IntEnum
from typing import Final

FACADE_REPEAT_M: Final = 6.4
"""Side of a façade texture on a wall [m]."""

FACADE_PX: Final = 512
"""Side of a façade texture [texels]."""

CELLS: Final = 4
"""A layer of openings (windows, doors) is cut into 4 × 4 cells, one of which fills an opening, whatever its size."""

CELL_M: Final = FACADE_REPEAT_M / CELLS


class FacadeTexture(IntEnum):
    """Index of a façade texture. The building's own colour multiplies walls."""

    PLAIN = -1
    """Vertex colours only."""
    RENDER = 0
    BRICK = 1
    CONCRETE = 2
    STONE = 3
    CLADDING = 4
    TILES = 5
    SLATE = 6
    SEAMS = 7
    GRAVEL = 8
    FELT = 9
    WINDOWS = 10
    GLAZING = 11
    DOORS = 12
