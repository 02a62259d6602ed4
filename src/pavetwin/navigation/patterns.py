"""Inspection patterns: the passes flown along a segment, and their registry."""

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np
import shapely
from shapely import LineString

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import PatternSettings
from pavetwin.registry import Registry
from pavetwin.world.model import Segment

Pass = Float64Array
"""The line flown, (n, 2) in the world frame."""

Pattern = Callable[[float, float, float, PatternSettings], Sequence[float]]
"""(left half-width, right half-width, window's width, settings) → the passes' offsets, metres to the left."""

PATTERNS: Registry[Pattern] = Registry(
    "pattern", key="pattern.kind", group="pavetwin.patterns", home="pavetwin.navigation.patterns"
)
pattern = PATTERNS.register
"""Register a pattern under a name, which `pattern.kind` then takes."""


def half_widths(segment: Segment) -> tuple[float, float]:
    """Extent of a segment's surface to the left and right of its centre line, in metres."""
    line = segment.centre_line
    rim = shapely.points(shapely.get_coordinates(shapely.segmentize(segment.polygon, 2.0)))
    at = shapely.line_locate_point(line, rim)
    step = min(0.5, line.length / 4)
    tail = shapely.get_coordinates(shapely.line_interpolate_point(line, np.clip(at - step, 0, line.length)))
    head = shapely.get_coordinates(shapely.line_interpolate_point(line, np.clip(at + step, 0, line.length)))
    foot = shapely.get_coordinates(shapely.line_interpolate_point(line, at))
    along, offset = head - tail, shapely.get_coordinates(rim) - foot
    side = (along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]) / np.maximum(np.hypot(*along.T), 1e-9)
    return max(float(side.max()), 0.5), max(float(-side.min()), 0.5)


def passes(segment: Segment, window_across_m: float, settings: PatternSettings) -> list[Pass]:
    """Passes of a segment in flying order, every other one backwards.

    Raises:
        PaveTwinError: there is no such pattern.
    """
    offsets = PATTERNS.get(settings.kind)(*half_widths(segment), window_across_m, settings)
    lines = [_parallel(segment.centre_line, offset) for offset in offsets]
    return [line[::-1] if number % 2 else line for number, line in enumerate(lines)]


def from_nearest_end(result: Sequence[Pass], start: tuple[float, float]) -> list[Pass]:
    """The passes, from the end of the first or last one that is nearest to `start`."""
    reverse = [line[::-1] for line in result]
    variants = (list(result), list(result)[::-1], reverse, reverse[::-1])
    return min(variants, key=lambda variant: float(np.hypot(*(variant[0][0] - start))))


def _parallel(line: LineString, offset_m: float) -> Pass:
    """The parallel of a line, `offset_m` to its left, in the same direction."""
    plain = shapely.simplify(line, 0.1)
    if abs(offset_m) < 1e-6:
        return shapely.get_coordinates(plain)
    curve = shapely.offset_curve(plain, offset_m, join_style="mitre", mitre_limit=2.0)
    parts = [part for part in shapely.get_parts(curve) if part.length > 0]
    if not parts:
        return shapely.get_coordinates(plain)
    points = shapely.get_coordinates(max(parts, key=lambda part: part.length))
    first = shapely.get_coordinates(plain)[0]
    backwards = np.hypot(*(points[-1] - first)) < np.hypot(*(points[0] - first))
    return points[::-1] if backwards else points


@pattern("boustrophedon")
def boustrophedon(left_m: float, right_m: float, window_m: float, settings: PatternSettings) -> Sequence[float]:
    """Evenly spaced parallel passes, at least one, for the window's width and the side overlap."""
    spare_m = left_m + right_m - window_m
    if spare_m <= 0:
        return [(left_m - right_m) / 2]
    count = ceil(spare_m / (window_m * (1 - settings.side_overlap)) - 1e-9) + 1
    return list(np.linspace(window_m / 2 - right_m, left_m - window_m / 2, count))


@pattern("out_and_back")
def out_and_back(
    left_m: float,
    right_m: float,
    window_m: float,  # noqa: ARG001
    settings: PatternSettings,  # noqa: ARG001
) -> Sequence[float]:
    """One pass over the middle of each half of the carriageway (arXiv 2606.20742)."""
    return [-right_m / 2, left_m / 2]
