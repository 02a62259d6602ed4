"""A close view of one segment, rotated so that the street is horizontal."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pavetwin.draw import style
from pavetwin.draw.mission_layers import (
    CLOSE,
    MapTransform,
    draw_defects,
    draw_parked,
    draw_reactions,
    draw_route,
    draw_surfaces,
    draw_windows,
)
from pavetwin.draw.world_map import EVERYTHING, MapLayer, draw_world
from pavetwin.mission.environment import window_m
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.result import MissionResult

TALLEST_IN = 2.0
GAP_IN = 0.1
NARROW_IN = 8.0
"""On a narrower page the caption takes two lines."""
CAPTION_IN = 0.28
_QUIET = EVERYTHING - {MapLayer.BASE, MapLayer.STREET_NAMES}


@dataclass(frozen=True)
class SegmentLayout:
    """Layout of a segment on a page of some width: its rotation, and the metres that are shown."""

    segment: str
    turn: MapTransform
    width_m: float
    height_m: float
    height_in: float
    width_in: float

    @property
    def caption_in(self) -> float:
        """Height of the line or lines above it."""
        return CAPTION_IN if self.width_in > NARROW_IN else CAPTION_IN + 0.16

    @property
    def with_caption_in(self) -> float:
        return self.caption_in + self.height_in + GAP_IN

    @staticmethod
    def of(result: MissionResult, segment: str, width_in: float, tallest_in: float = TALLEST_IN) -> "SegmentLayout":
        """The largest scale at which the whole segment and the windows around it fit."""
        place = result.environment.world.segment(segment)
        turn = MapTransform.along(place)
        left, bottom, right, top = turn.shape(place.polygon).bounds
        across, along = window_m(result.settings)
        long_m = max(right - left, 30.0) + along + 2
        high_m = max(top - bottom, 6.0) + float(np.clip(across - place.width_m, 4.0, 9.0)) + 1
        per_m = min(width_in / long_m, tallest_in / high_m)
        return SegmentLayout(segment, turn, width_in / per_m, high_m, high_m * per_m, width_in)

    def heightened(self, height_in: float) -> "SegmentLayout":
        return replace(self, height_in=height_in, height_m=self.height_m * height_in / self.height_in)

    def outline(self) -> shapely.Polygon:
        """Its frame in the world frame."""
        x, y = self.width_m / 2, self.height_m / 2
        return shapely.Polygon(self.turn.back([(-x, -y), (x, -y), (x, y), (-x, y)]))


def draw_strip(
    figure: Figure, strip: SegmentLayout, result: MissionResult, corner_in: tuple[float, float], *, scale: bool = True
) -> Axes:
    """Draw a strip.

    Args:
        corner_in: its lower left, in inches of the figure.
        scale: with a scale bar and an arrow to the north above it.
    """
    (left, bottom), width = corner_in, strip.width_in
    axes = style.axes_in(figure, left, bottom, width, strip.height_in)
    x, y = strip.width_m / 2, strip.height_m / 2
    near = strip.turn.world(result.environment.world, float(np.hypot(x, y)) + 5)
    draw_world(axes, near, bounds=(-x, -y, x, y), layers=_QUIET, defects=False, muted=True)
    index = next(i for i, segment in enumerate(result.environment.world.segments) if segment.id == strip.segment)
    draw_surfaces(axes, result, strip.turn)
    draw_windows(axes, result, strip.turn, index)
    draw_parked(axes, result, strip.turn)
    draw_route(axes, result, strip.turn, CLOSE)
    draw_defects(axes, result, strip.turn, CLOSE)
    draw_reactions(axes, result, strip.turn, CLOSE)
    if scale:
        above = style.panel(figure, left, bottom + strip.height_in, width, strip.caption_in)
        first_line = strip.caption_in - CAPTION_IN
        style.scale_bar(above, width - 0.5, first_line + 0.05, width / strip.width_m, longest=0.85)
        style.north_arrow(above, width - 0.12, first_line + 0.13, 0.18, turn_rad=-strip.turn.angle_rad)
    return axes


def _at_most(row: SegmentMetrics) -> str:
    return f" (of at most {100 * (1 - row.permanently_hidden):.0f} %)" if row.permanently_hidden else ""


def caption(row: SegmentMetrics) -> str:
    """Summary of a segment in one line."""
    parts = {
        f"{row.confirmed} of {row.defects} defects found": True,
        f"{row.recovered} of them on return": row.recovered,
        f"surface {100 * row.surface_coverage:.0f} %{_at_most(row)}": True,
        f"{row.occlusions} occlusion{'s' if row.occlusions != 1 else ''}": True,
        f"waited {row.wait_s:.0f} s": row.wait_s >= 0.5,
        f"{row.revisits} revisit{'s' if row.revisits != 1 else ''}": row.revisits,
        f"{row.time_s:.0f} s in all": True,
    }
    return " · ".join(part for part, applies in parts.items() if applies)
