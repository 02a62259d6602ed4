"""Map layers of a mission: parked vehicles, route, captured windows, defects, waits, displacements and revisits.

Every function draws into axes in metres, either of the world frame or of a page rotated along a street.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import FancyArrowPatch

from pavetwin.arrays import Float64Array
from pavetwin.draw import shapes, style
from pavetwin.draw.lettering import OccupiedSpace
from pavetwin.draw.marks import DefectOutcome, outcomes, rectangles, windows
from pavetwin.draw.turned import MapTransform
from pavetwin.draw.world_map import ABOVE_WORLD, base_symbol
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import HoverStop, avoiding, displacements, inspecting, revisits, runs, waits

CAPTURED, GAP = "#CFE2EF", "#F3CDB4"
"""Pavement of an inspected segment inside and outside all captured windows."""

PARKED, PARKED_EDGE = "#A9ABB0", "#85888F"

WAIT, REVISIT, STEP, BATTERY, AVOID = "#5B2A86", "#0063B1", "#B0307A", "#7A5A00", "#00A0A0"

NAMES = ABOVE_WORLD + 13
"""Street names, between the route and the marks on it."""

_LABELLED = 8
"""At most this many waits are labelled."""

_SURFACE, _WINDOWS, _ROUTE, _STAYS, _DEFECTS, _LABELS = (ABOVE_WORLD + 5 * level for level in range(6))
_PARKED = _WINDOWS + 2


@dataclass(frozen=True, slots=True)
class Weights:
    """Sizes of the marks: lengths in points, areas in square points."""

    transit: float
    inspection: float
    defect: float
    wait_area_per_s: float
    label: float

    def times(self, factor: float) -> "Weights":
        """For a smaller scale: lengths by the factor, areas by its square."""
        lengths = {"transit": self.transit * factor**0.5, "inspection": self.inspection * factor}
        areas = {"defect": self.defect * factor**2, "wait_area_per_s": self.wait_area_per_s * factor**2}
        return replace(self, **lengths, **areas)


TOWN = Weights(transit=0.55, inspection=1.5, defect=5.0, wait_area_per_s=1.6, label=6.5)
CLOSE = Weights(transit=0.8, inspection=1.8, defect=26.0, wait_area_per_s=4.0, label=7.0)


def wait_area(seconds: float, weights: Weights) -> float:
    """The area of a wait's disc in square points: in proportion to its seconds, and never too small to be seen."""
    return max(14.0, weights.wait_area_per_s * seconds)


def draw_surfaces(axes: Axes, result: MissionResult, turn: MapTransform) -> None:
    """The inspected segments: what some captured window covered, and the gaps."""
    index = {segment.id: number for number, segment in enumerate(result.environment.world.segments)}
    names = list(dict.fromkeys(row.segment for row in result.rows))
    polygons = [turn.shape(result.environment.world.segment(name).polygon) for name in names]
    shown = shapes.seen(axes, polygons)
    covered = []
    for number in shown:
        corners, _ = windows(result, index[names[number]])
        if len(corners):
            captured = shapely.union_all(shapely.polygons(turn.points(corners)))
            covered.append(shapely.intersection(polygons[number], captured))
    shapes.fill(axes, [polygons[number] for number in shown], _SURFACE, GAP)
    shapes.fill(axes, covered, _SURFACE, CAPTURED)


def draw_windows(axes: Axes, result: MissionResult, turn: MapTransform, segment: int) -> None:
    """The pavement in each captured window of a segment, coloured by visibility, deeper where windows overlap."""
    corners, visibility = windows(result, segment)
    if not len(corners):
        return
    faces, edges = style.VISIBILITY(visibility), style.VISIBILITY(visibility)
    faces[:, 3], edges[:, 3] = 0.20, 0.45
    polygon = turn.shape(result.environment.world.segments[segment].polygon)
    inside = np.asarray(shapely.intersection(shapely.polygons(turn.points(corners)), polygon))
    touching = ~shapely.is_empty(inside)
    shapes.fill(axes, inside[touching].tolist(), _WINDOWS, faces[touching], edges[touching], 0.45)


def draw_parked(axes: Axes, result: MissionResult, turn: MapTransform) -> None:
    """The parked vehicles in view, as the boxes that hide the pavement."""
    parked = result.environment.parked
    corners = rectangles(parked.x, parked.y, parked.yaw_rad, parked.width_m, parked.length_m)
    boxes = [shapely.Polygon(ring) for ring in turn.points(corners)]
    shown = [boxes[index] for index in shapes.seen(axes, boxes)]
    shapes.fill(axes, shown, _PARKED, PARKED, PARKED_EDGE, min(0.5, 0.15 * shapes.points_per_m(axes)))
    axes.collections[-1].set_gid("parked")


def draw_route(axes: Axes, result: MissionResult, turn: MapTransform, weights: Weights) -> None:
    """The track flown: thin in transit, thick and coloured by visibility while inspecting, in a band while giving
    way."""
    xy = turn.points(np.column_stack([result.track["x_m"], result.track["y_m"]]))

    def add(lines: Sequence[Float64Array], colour: Any, width_pt: float, level: int, **other: Any) -> None:
        lines_ = LineCollection(lines, colors=colour, linewidths=width_pt, zorder=_ROUTE + level, **other)
        axes.add_collection(lines_, autolim=False)

    away = [xy[max(rows.start - 1, 0) : rows.stop + 1] for rows in runs(avoiding(result.track))]
    add(away, AVOID, weights.inspection + 4, -1, alpha=0.4, capstyle="round", gid="avoiding")
    seen = inspecting(result.track)
    add([xy[rows.start : rows.stop + 1] for rows in runs(~seen)], style.INK, weights.transit, 0, alpha=0.75)
    legs = [xy[rows.start : rows.stop] for rows in runs(seen)]
    add(legs, style.PAPER, weights.inspection + 1.2, 1, capstyle="round")
    steps = list(np.stack([xy[:-1], xy[1:]], axis=1)[seen[:-1]])
    colours = style.VISIBILITY(result.track["visibility"][:-1][seen[:-1]])
    add(steps, colours, weights.inspection, 2, capstyle="round")


def draw_defects(axes: Axes, result: MissionResult, turn: MapTransform, weights: Weights) -> None:
    """One mark a defect of the inspected segments: confirmed, recovered or missed."""
    found = outcomes(result)
    places = np.array([(d.centre.x, d.centre.y) for d in result.environment.defects]).reshape(-1, 2)
    for number, outcome in enumerate(DefectOutcome):
        which = [defect for defect, is_ in found.items() if is_ is outcome]
        spots = turn.points(places[which])
        larger = {DefectOutcome.CONFIRMED: 0.75, DefectOutcome.RECOVERED: 1.5}.get(outcome, 1.7)
        marks = axes.scatter(
            spots[:, 0], spots[:, 1], s=weights.defect * larger, marker=style.OUTCOME_MARKERS[outcome],
            color=style.OUTCOME_COLOURS[outcome], edgecolors=style.PAPER, linewidths=0.35, zorder=_DEFECTS + number,
        )  # fmt: skip
        marks.set_gid(f"defects-{outcome}")


def draw_reactions(
    axes: Axes, result: MissionResult, turn: MapTransform, weights: Weights, frames: Sequence[shapely.Polygon] = ()
) -> None:
    """The policy's reactions: discs for waits, arrows for displacements, rings for revisits.

    Args:
        frames: what is drawn larger beside this map, with the seconds of its waits, in metres of the world.
    """
    stays = sorted(waits(result.track), key=lambda stay: -stay.seconds)
    if stays:
        x, y = turn.points([stay.position for stay in stays]).T
        areas = [wait_area(stay.seconds, weights) for stay in stays]
        axes.scatter(x, y, s=areas, color=WAIT, alpha=0.22, linewidths=0, zorder=_STAYS)
        rims = axes.scatter(x, y, s=areas, facecolors="none", edgecolors=WAIT, linewidths=0.9, zorder=_STAYS + 1)
        rims.set_gid("waits")
    again = revisits(result.track)
    if again:
        x, y = turn.points([stay.position for stay in again]).T
        axes.scatter(
            x, y, s=5 * weights.defect**0.7 + 8, marker="s", facecolors="none",
            edgecolors=REVISIT, linewidths=0.9, zorder=_STAYS,
        ).set_gid("revisits")  # fmt: skip
    for step in displacements(result.track):
        start, end = turn.points([step.start, step.end])
        head = "-|>,head_length=2.6,head_width=1.5"
        arrow = FancyArrowPatch(
            tuple(start), tuple(end), arrowstyle=head, shrinkA=0, shrinkB=0, color=STEP, linewidth=1.0
        )
        arrow.set_zorder(_STAYS + 3)
        axes.add_patch(arrow)
        if weights.defect < CLOSE.defect:
            axes.plot(*start, marker="^", ms=3.2, mfc=STEP, mec=style.PAPER, mew=0.3, zorder=_STAYS + 3)
    told = [stay for stay in stays if not any(frame.contains(shapely.Point(stay.position)) for frame in frames)]
    _label_waits(axes, told, stays, turn, weights)


def draw_stations(axes: Axes, result: MissionResult, turn: MapTransform) -> None:
    low = [place.position for place in result.actions if place.action == "battery"]
    if low:
        x, y = turn.points(low).T
        axes.scatter(x, y, s=34, marker="P", c=BATTERY, edgecolors=style.PAPER, linewidths=0.7, zorder=_LABELS)
    base_symbol(axes, result.environment.world, zorder=_LABELS)


def _label_waits(
    axes: Axes, told: Sequence[HoverStop], stays: Sequence[HoverStop], turn: MapTransform, weights: Weights
) -> None:
    """Seconds beside the longest of the waits that are told, where they fit: no label overlaps another one or the
    centre of any wait."""
    if not told:
        return
    pt_px = axes.figure.dpi / 72

    def spots(of: Sequence[HoverStop]) -> Float64Array:
        return np.asarray(axes.transData.transform(turn.points([stay.position for stay in of])))

    size, view, occupied = weights.label * pt_px, shapely.box(*axes.get_window_extent().extents), OccupiedSpace()
    for spot in spots(stays):
        occupied.take(shapely.Point(spot))
    for stay, spot in list(zip(told, spots(told), strict=True))[:_LABELLED]:
        radius = (wait_area(stay.seconds, weights) / np.pi) ** 0.5 * pt_px
        text = f"{stay.seconds:.0f} s"
        half = 0.33 * size * len(text)
        for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1), (0.8, 0.8), (-0.8, 0.8), (0.8, -0.8), (-0.8, -0.8)):
            x, y = spot + (right * (radius + half + 2), up * (radius + 0.7 * size))
            plate = shapely.box(x - half, y - 0.55 * size, x + half, y + 0.55 * size)
            if view.contains(plate) and occupied.free(plate):
                occupied.take(plate)
                x, y = axes.transData.inverted().transform((x, y))
                axes.text(
                    x, y, text, fontsize=weights.label, color=WAIT,
                    fontweight="bold", ha="center", va="center", zorder=_LABELS + 1, path_effects=style.halo(),
                )  # fmt: skip
                break
