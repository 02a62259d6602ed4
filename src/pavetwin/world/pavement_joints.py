"""Joints and gutters of pavements: between slabs of concrete, between lanes that were paved apart, and along kerbs.

All depend on a street's name and a segment's own geometry alone, so that defects and scenes agree, and a street is
independent of others. Asphalt defects avoid gutters.
"""

import zlib
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Segment

SLAB_SHARE: Final = 0.08
"""Share of streets built of slabs of concrete. Where a scene's look has them paved over, their joints are reflected by
cracks. Ours."""

SLAB_M: Final = 4.5
"""From joint to joint along a street."""

SLAB_WIDTH_M: Final = 3.6
"""Across it, about; the carriageway is divided into slabs of one width."""

APART_SHARE: Final = 0.4
"""Share of the other streets whose lanes were paved one after the other, with a cold joint between them. Ours."""


def has_slabs(street: str) -> bool:
    """Whether the street of a name was built of slabs."""
    return _share(f"slabs {street}") < SLAB_SHARE


def is_paved_apart(street: str) -> bool:
    """Whether the lanes of the street of a name were paved apart; none of slabs is."""
    return not has_slabs(street) and _share(f"apart {street}") < APART_SHARE


def joints_across(segment: Segment, every_m: float = SLAB_M) -> Float64Array:
    """Stations along a segment of the joints between slabs of a length [m]."""
    return np.arange(every_m * _share(f"joints {segment.id}"), segment.length_m, every_m)


def joints_along(segment: Segment) -> Float64Array:
    """Offsets to the left of a segment's centre line at which slabs meet [m]."""
    return _borders(segment, max(1, round(segment.width_m / SLAB_WIDTH_M)))


def slab_width_m(segment: Segment) -> float:
    """Width of a segment's slabs [m]."""
    return segment.width_m / (len(joints_along(segment)) + 1)


def lane_joints(segment: Segment) -> Float64Array:
    """Offsets to the left of a segment's centre line at which lanes meet [m]; a single lane is paved in two halves."""
    return _borders(segment, max(2, segment.lanes))


def _borders(segment: Segment, parts: int) -> Float64Array:
    return np.asarray(segment.width_m * (np.arange(1, parts) / parts - 0.5), dtype=np.float64)


def _share(what: str) -> float:
    """A hash of a text, 0 … 1."""
    return zlib.crc32(what.encode()) / 2**32


GUTTER_M: Final = 0.30
"""Width of a gutter of concrete slabs or cast with the kerb (RASt 06: 30 cm)."""

SHARE: Final = 0.45
"""Share of streets with gutters."""


def has_gutter(street: str) -> bool:
    """Whether the street of a name was built with gutters; they lie where it has kerbs."""
    return zlib.crc32(f"gutter {street}".encode()) < SHARE * 2**32
