"""Which streets have gutters of concrete between their asphalt and their kerbs.

Asphalt defects avoid them and the scene draws them. The result depends on the street's name alone: it is the same for
all segments of a street and independent of other streets.
"""

import zlib
from typing import Final

GUTTER_M: Final = 0.30
"""Width of a gutter of concrete slabs or cast with the kerb (RASt 06: 30 cm)."""

SHARE: Final = 0.45
"""Of streets."""


def has_gutter(street: str) -> bool:
    """Whether the street of a name was built with gutters; they lie where it has kerbs."""
    return zlib.crc32(f"gutter {street}".encode()) < SHARE * 2**32
