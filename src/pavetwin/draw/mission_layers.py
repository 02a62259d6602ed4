"""Map layers of a mission and their legend, also rotated so that a street is horizontal."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import atan2, cos, sin
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch
from shapely import Point

from pavetwin.arrays import Float64Array
from pavetwin.draw import shapes, style
from pavetwin.draw.lettering import OccupiedSpace
from pavetwin.draw.mission_marks import DefectOutcome, outcomes, rectangles, windows
from pavetwin.draw.world_map import ABOVE_WORLD, base_symbol
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import HoverStop, avoiding, displacements, inspecting, revisits, runs, waits
from pavetwin.world.model import Segment, World

Shape = TypeVar("Shape", bound=shapely.Geometry)
Item = TypeVar("Item", bound=Any)


@dataclass(frozen=True, slots=True)
class MapTransform:
    """From the world frame to the page: the place `origin` comes to (0, 0), the direction `angle_rad` to the right."""

    origin: tuple[float, float]
    angle_rad: float

    @staticmethod
    def along(segment: Segment) -> "MapTransform":
        """With the middle of a segment's box at the origin, its ends level, running to the right or upwards."""
        line = shapely.get_coordinates(segment.centre_line)
        chord = line[-1] - line[0]
        angle = atan2(float(chord[1]), float(chord[0]))
        if cos(angle) < -1e-9:
            angle += np.pi
        plain = MapTransform((0.0, 0.0), angle)
        low, high = np.reshape(plain.shape(segment.polygon).bounds, (2, 2))
        middle = plain.back((low + high) / 2)
        return MapTransform((float(middle[0]), float(middle[1])), angle)

    @property
    def _axes(self) -> Float64Array:
        """(2, 2) the page's directions in the world, a column each."""
        c, s = cos(self.angle_rad), sin(self.angle_rad)
        return np.array([[c, -s], [s, c]])

    def points(self, xy: npt.ArrayLike) -> Float64Array:
        """World (..., 2) to page (..., 2), metres both."""
        return (np.asarray(xy, dtype=np.float64) - self.origin) @ self._axes

    def back(self, xy: npt.ArrayLike) -> Float64Array:
        """Page (..., 2) to world (..., 2)."""
        return np.asarray(xy, dtype=np.float64) @ self._axes.T + self.origin

    def shape(self, geometry: Shape) -> Shape:
        return shapely.transform(geometry, self.points)

    def world(self, world: World, reach_m: float) -> World:
        """The world within `reach_m` of the origin, on the page. Only its geometry may be used."""
        disc = Point(self.origin).buffer(reach_m)

        def near(items: Iterable[Item], *geometries: str) -> tuple[Item, ...]:
            """Items whose first geometry touches the disc, on the page."""
            return tuple(
                replace(item, **{name: self.shape(getattr(item, name)) for name in geometries})
                for item in items
                if disc.intersects(getattr(item, geometries[0]))
            )

        return replace(
            world,
            streets=near(world.streets, "centre_line"),
            segments=near(world.segments, "polygon", "centre_line"),
            lanes=near(world.lanes, "centre_line"),
            connections=near(world.connections, "centre_line"),
            junctions=near(world.junctions, "polygon"),
            crossings=near(world.crossings, "polygon"),
            buildings=near(world.buildings, "polygon"),
            furniture=tuple(
                replace(item, yaw_rad=item.yaw_rad - self.angle_rad) for item in near(world.furniture, "position")
            ),
            parks=tuple(self.shape(park) for park in world.parks if disc.intersects(park)),
            defects=near(world.defects, "centre", "polygon"),
            base=self.shape(world.base),
        )


CAPTURED, GAP = "#CFE2EF", "#F3CDB4"
"""Pavement of an inspected segment inside and outside all captured windows."""

PARKED, PARKED_EDGE = "#A9ABB0", "#85888F"

WAIT, REVISIT, STEP, BATTERY, AVOID = "#5B2A86", "#0063B1", "#B0307A", "#7A5A00", "#00A0A0"

NAMES = ABOVE_WORLD + 13
"""Street names, between the route and the marks on it."""

_LABELLED = 8  # At most this many waits are labelled
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
        frames: segments drawn larger next to this map, with the seconds of its waits, in metres of the world.
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
    """Seconds next to the longest waits, where they fit: no label overlaps another one or the
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


Handle = Artist | tuple[Artist, ...]


def main_numbers(result: MissionResult) -> list[tuple[str, str]]:
    """The mission's results, as names and readable values."""
    rows = result.rows
    defects, confirmed = sum(row.defects for row in rows), sum(row.confirmed for row in rows)
    area = sum(row.area_m2 for row in rows)
    minutes, seconds = divmod(round(result.duration_s), 60)
    recovered, seen = sum(row.recovered for row in rows), 100 * result.settings.visibility.inspected_share
    covered = sum(row.surface_coverage * row.area_m2 for row in rows)
    hidden = sum(row.permanently_hidden * row.area_m2 for row in rows)
    numbers = (
        (
            True,
            "Segments inspected" if hidden else f"Segments at least {seen:g} % seen",
            f"{sum(row.inspected for row in rows)} of {len(rows)}",
        ),
        (defects, "Defects found", f"{confirmed} of {defects} ({100 * confirmed / max(1, defects):.0f} %)"),
        (recovered, "Found on return", f"{recovered}"),
        (area, "Surface seen", f"{100 * (covered / (area or 1)):.1f} %"),
        (hidden, "Surface that can be seen", f"{100 * (1 - hidden / (area or 1)):.1f} %"),
        (True, "Time", f"{minutes}:{seconds:02d} min"),
        (True, "Waiting", f"{sum(row.wait_s for row in rows):.0f} s"),
        (True, "Occlusions", f"{sum(row.occlusions for row in rows)}"),
        (True, "Distance", f"{result.distance_m / 1000:.2f} km"),
        (True, "Energy", f"{100 * result.energy:.0f} % of a battery"),
        (result.swaps, "Batteries to bring", f"{result.swaps + 1}"),
    )
    return [(name, value) for applies, name, value in numbers if applies]


def legend_of(results: Sequence[MissionResult], *, town: bool) -> tuple[list[Handle], list[str]]:
    """Only what is on the map."""
    ramp = tuple(Line2D([], [], color=style.VISIBILITY(o), linewidth=2.6) for o in (0.3, 0.7, 1.0))
    parked = Patch(facecolor=PARKED, edgecolor=PARKED_EDGE, linewidth=0.5)
    entries: list[tuple[object, Handle, str]] = [
        (True, Line2D([], [], color=style.INK, linewidth=0.8), "Transit"),
        (True, ramp, "Inspection, by visibility o"),
        (True, Patch(facecolor=CAPTURED), "In a captured window"),
        (True, Patch(facecolor=GAP), "In no captured window"),
        (any(len(result.environment.parked) for result in results), parked, "Parked vehicle"),
    ]
    found = {outcome for result in results for outcome in outcomes(result).values()}
    for outcome in DefectOutcome:
        mark = _mark(style.OUTCOME_MARKERS[outcome], style.OUTCOME_COLOURS[outcome], 5, mec=style.PAPER, mew=0.4)
        entries.append((outcome in found, mark, f"Defect {outcome}"))
    tracks = [result.track for result in results]
    gave_way = any(avoiding(track).any() for track in tracks)
    entries += [
        (any(map(waits, tracks)), _mark("o", WAIT, 8, mfc=WAIT + "38", mew=0.9), "Waiting; area by seconds"),
        (any(map(displacements, tracks)), _mark("^" if town else ">", STEP, 5), "Displacement"),
        (any(map(revisits, tracks)), _mark("s", REVISIT, 6, mfc="none", mew=0.9), "Place revisited"),
        (gave_way, Line2D([], [], color=AVOID, linewidth=5, alpha=0.4), "Giving way to aircraft"),
        (town and results[0].swaps, _mark("P", BATTERY, 6), "Battery low"),
        (town, _mark("o", style.BASE, 7), "Base"),
    ]
    shown = [(handle, label) for is_shown, handle, label in entries if is_shown]
    return [handle for handle, _ in shown], [label for _, label in shown]


def _mark(marker: str, colour: str, size_pt: float, **options: Any) -> Line2D:
    return Line2D([], [], marker=marker, color=colour, linestyle="", markersize=size_pt, **options)


def visibility_ramp(axes: Axes, box: tuple[float, float, float, float], threshold: float) -> None:
    """The colours of visibility with τ_o marked; `box` in shares of the axes."""
    bar = axes.inset_axes(box)
    bar.imshow(np.linspace(0, 1, 256)[None], cmap=style.VISIBILITY, aspect="auto", extent=(0, 1, 0, 1))
    bar.set(yticks=[], xticks=[0, 0.5, threshold, 1], xticklabels=["0", "0.5", f"τ = {threshold:g}", "1"])
    bar.axvline(threshold, color=style.INK, linewidth=1.0)
    bar.tick_params(labelsize=7, length=2, pad=1.5)
    bar.set_title("Visibility o", fontsize=7.5, fontweight="normal", color=style.INK_SOFT, pad=3)
    bar.grid(False)
    for spine in bar.spines.values():
        spine.set_visible(False)
