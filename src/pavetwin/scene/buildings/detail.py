"""How finely buildings are made."""

from enum import IntEnum


class HouseDetail(IntEnum):
    """All levels have the same walls, roofs and random choices."""

    FULL = 0
    """Openings set back into their walls, with reveals and sills; cornices, eaves, ridges."""
    FLAT = 1
    """Openings lie on their walls; roofs without eaves and ridge tiles."""
    BLANK = 2
    """Walls without openings; roofs without equipment, hipped ones in wide steps."""
