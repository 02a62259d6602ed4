"""Dependence of the chance of finding a defect on the size of a pixel on the ground.

Below `least_px` pixels across, a defect is not seen. Above, the chance rises along a smoothstep, s = 3t² − 2t³, to all
of `recall` at `full_recall_ratio` times `least_px`. Sources and assumptions stand in
docs/explanation/definitions.md, "Detection and resolution".
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import Final

from pavetwin.config.mission import SensingSettings
from pavetwin.defects.measures import Orientation, extents_m, orientations
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.world.model import Defect

LEAST_PX_THIN: Final = 2.0
LEAST_PX_OTHER: Final = 8.0
"""`least_px` of a user's own classes that the settings do not name."""


def is_thin(kind: str) -> bool:
    """Whether a class is registered as thin; False for a class of the world whose file was not given."""
    return kind in DEFECT_CLASSES.names() and DEFECT_CLASSES.get(kind).is_thin


def smallest_extent_m(defect: Defect) -> float:
    """The width of a crack; of any other defect the shorter side of the smallest rectangle around it."""
    if is_thin(defect.kind):
        return defect.width_m
    return extents_m(defect.polygon)[1]


def orientations_of(defect: Defect) -> Sequence[Orientation]:
    """The directions of a thin defect's centre line; empty for any other, which has edges in all directions."""
    return orientations(defect.polygon) if is_thin(defect.kind) else ()


def least_px_of(settings: SensingSettings, kind: str) -> float:
    """The fewest pixels across at which a class is seen; 0 where size does not matter."""
    if settings.least_px is None:
        return 0.0
    return settings.least_px.get(kind, LEAST_PX_THIN if is_thin(kind) else LEAST_PX_OTHER)


def sighted_share(settings: SensingSettings, frame: Frame, sighting: Sighting) -> float:
    """The share of `recall` that is left of a sighting, 0 … 1: of a thin defect the mean over its length.

    Motion blur is charged where it lies across. A pothole or a network of cracks has edges in all directions, of which
    those across the motion are seen worst, so that all of the blur counts.
    """
    extent = _extent(settings, sighting.defect.kind, sighting.across_m, sighting.visible_fraction)
    worst = _risen(settings, extent / frame.blurred_pixel_m)
    if worst == 1.0 or not sighting.orientations:
        return worst
    if _risen(settings, extent / frame.ground_resolution_m) == 0.0:
        return 0.0
    return sum(
        share * _risen(settings, extent / frame.pixel_across_m(east, north))
        for east, north, share in sighting.orientations
    )


def _extent(settings: SensingSettings, kind: str, across_m: float, visible_fraction: float) -> float:
    """Largest side of a pixel, in metres, at which a defect is still seen; infinite where size does not matter."""
    least = least_px_of(settings, kind)
    if not least:
        return inf
    return (across_m if is_thin(kind) else across_m * sqrt(visible_fraction)) / least


def _risen(settings: SensingSettings, ratio: float) -> float:
    """Smoothstep of the ratio of pixels to the fewest pixels, 0 … 1."""
    risen = min(max((ratio - 1.0) / (settings.full_recall_ratio - 1.0), 0.0), 1.0)
    return risen * risen * (3.0 - 2.0 * risen)
