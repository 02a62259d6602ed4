"""How the chance of finding a defect falls with what a pixel covers.

Below `least_px` pixels across, a defect is not seen. Above, the chance rises along a smoothstep, s = 3t² − 2t³, to all
of `recall` at `full_recall_ratio` times `least_px`. Sources and assumptions stand in
docs/explanation/definitions.md, "Detection and resolution".
"""

from collections.abc import Mapping
from math import sqrt
from typing import Final

from pavetwin.config.mission import SensingSettings
from pavetwin.defects.measures import extents_m
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.world.model import Defect

LEAST_PX_THIN: Final = 2.0
LEAST_PX_OTHER: Final = 8.0
"""Of the user's own classes, where the settings do not name them."""


def is_thin(kind: str) -> bool:
    """By its registration; a class of the world alone, whose file was not given, is not."""
    return kind in DEFECT_CLASSES.names() and DEFECT_CLASSES.get(kind).is_thin


def smallest_extent_m(defect: Defect) -> float:
    """The width of a crack; of any other defect the shorter side of the smallest rectangle around it."""
    if is_thin(defect.kind):
        return defect.width_m
    return extents_m(defect.polygon)[1]


def least_px_of(settings: SensingSettings, kind: str) -> float:
    """The fewest pixels across at which a class is seen; 0 where size does not matter."""
    if settings.least_px is None:
        return 0.0
    return settings.least_px.get(kind, LEAST_PX_THIN if is_thin(kind) else LEAST_PX_OTHER)


def least_extents_m(settings: SensingSettings, pixel_m: float, kinds: tuple[str, ...]) -> Mapping[str, float]:
    """For each class the extent below which a defect is not seen; empty where size does not matter.

    Args:
        pixel_m: what a pixel covers, with its blur.
    """
    return {} if settings.least_px is None else {kind: least_px_of(settings, kind) * pixel_m for kind in kinds}


def resolved_share(
    settings: SensingSettings, kind: str, across_m: float, pixel_m: float, visible_fraction: float = 1.0
) -> float:
    """The share of `recall` that is left at this resolution, 0 … 1.

    Of a crack the width counts, of any other defect the shorter side of what is visible: its shorter side times the
    root of the visible fraction.

    Args:
        across_m: as `smallest_extent_m` gives it.
        pixel_m: what a pixel covers, with its blur.
    """
    least = least_px_of(settings, kind)
    if not least:
        return 1.0
    extent_m = across_m if is_thin(kind) else across_m * sqrt(visible_fraction)
    ratio = extent_m / (least * pixel_m)
    risen = min(max((ratio - 1.0) / (settings.full_recall_ratio - 1.0), 0.0), 1.0)
    return risen * risen * (3.0 - 2.0 * risen)
