"""The figure of a mission: the town with the route, close views of notable segments, and the main numbers."""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple

from pavetwin.draw import lettering, mission_layers, shapes, style
from pavetwin.draw.extent import credit
from pavetwin.draw.fonts import families, shown_label, shown_names
from pavetwin.draw.mission_layers import MapTransform, legend_of, main_numbers, visibility_ramp
from pavetwin.draw.mission_marks import notable_segments, why_notable
from pavetwin.draw.strip import CAPTION_IN, GAP_IN, TALLEST_IN, SegmentLayout, caption, draw_strip
from pavetwin.draw.world_map import ABOVE_WORLD, MapLayer, draw_world
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import window_m
from pavetwin.mission.result import MissionResult
from pavetwin.traffic.demand import USER
from pavetwin.world.ground import Bounds
from pavetwin.world.model import World

WIDTH_IN = 10.0
MARGIN_IN = 0.25
HEAD_IN = 0.62
SIDE_IN = 2.35
"""The column of numbers and legend next to the town."""

GUTTER_IN = 0.2
TALLEST_TOWN_IN = 6.6
NUMBERS_IN = 3.0
"""Height of numbers and legend where they stand side by side."""
LEGEND_ROW_IN = 0.182

_AROUND_FRAME_PT = 12.0  # Free of street names, for the letter of a frame and for labels of waits
AROUND_M = 25.0
"""Margin around everything that was flown over."""

_PLAIN = MapTransform((0.0, 0.0), 0.0)
_QUIET = {MapLayer.PARKS, MapLayer.BUILDINGS, MapLayer.SIDEWALKS, MapLayer.CARRIAGEWAYS}


def save_mission_map(result: MissionResult, path: Path) -> None:
    """Write the image of one mission (PNG, SVG or PDF by the suffix).

    Raises:
        PaveTwinError: the suffix is another, or the file cannot be written.
    """
    with style.styled():
        figure = mission_figure(result)
        style.save_figure(figure, path)


def mission_figure(result: MissionResult) -> Figure:
    """The town, numbers and legend next to it, and close views below or, next to a narrow town, under the numbers."""
    inner = WIDTH_IN - 2 * MARGIN_IN
    bounds = flown_bounds(result)
    ratio = (bounds[2] - bounds[0]) / (bounds[3] - bounds[1])
    town_h = float(np.clip((inner - SIDE_IN) / ratio, 4.6, TALLEST_TOWN_IN))
    town_w = float(np.clip(town_h * ratio, 3.2, inner - SIDE_IN))
    narrow = inner - town_w > 2 * SIDE_IN + 0.6
    town_w = town_w if narrow else inner - SIDE_IN
    bounds = style.fitted(bounds, town_w / town_h)
    side_w = inner - town_w - GUTTER_IN
    strips = [SegmentLayout.of(result, name, side_w if narrow else inner) for name in notable_segments([result])[:3]]
    height_in = town_h - NUMBERS_IN if narrow else 2 * TALLEST_IN + 1
    strips = [s for n, s in enumerate(strips) if sum(each.with_caption_in for each in strips[: n + 1]) <= height_in]
    strips = _heightened(strips, height_in) if narrow else strips[:2]
    below = 0.0 if narrow else sum(strip.with_caption_in for strip in strips)
    height = MARGIN_IN + below + GAP_IN + town_h + HEAD_IN
    figure = style.new_figure(WIDTH_IN, height)
    _heading(figure, result.environment.world.name, f"policy {result.policy}", result)
    bottom = height - HEAD_IN - town_h
    town = style.axes_in(figure, MARGIN_IN, bottom, town_w, town_h)
    _draw_town(town, result, bounds, strips)
    left = MARGIN_IN + town_w + GUTTER_IN
    side = style.panel(figure, left, bottom, side_w, town_h)
    _draw_side(side, result, town_w / (bounds[2] - bounds[0]), narrow=narrow)
    x, y = (left, bottom + sum(s.with_caption_in for s in strips) - GAP_IN) if narrow else (MARGIN_IN, bottom - GAP_IN)
    for number, strip in enumerate(strips):
        y -= strip.caption_in
        _caption(figure, (x, y), result, strip, "abc"[number], style.INK)
        y -= strip.height_in
        draw_strip(figure, strip, result, (x, y))
        y -= GAP_IN
    return figure


def _heightened(strips: Sequence[SegmentLayout], available_in: float) -> list[SegmentLayout]:
    """Strips that show more on both sides of their streets, as far as the height allows."""
    spare_in = available_in - sum(strip.with_caption_in for strip in strips)
    return [strip.heightened(min(TALLEST_IN, strip.height_in + spare_in / len(strips))) for strip in strips]


def save_comparison_map(results: Sequence[MissionResult], path: Path) -> None:
    """Write one close view per mission, all of the segment most worth a comparison.

    Args:
        results: missions over the same world at the same altitude, such as one a policy.

    Raises:
        PaveTwinError: no segment was inspected by all, the suffix is unknown, or the file cannot be written.
    """
    common = [
        name for name in notable_segments(results) if all(name in {row.segment for row in f.rows} for f in results)
    ]
    if not common:
        raise PaveTwinError("The missions have no segment in common, so that they cannot be compared on a map.")
    with style.styled():
        style.save_figure(_comparison_figure(results, common[0]), path)


def _comparison_figure(results: Sequence[MissionResult], segment: str) -> Figure:
    inner = WIDTH_IN - 2 * MARGIN_IN
    strip = SegmentLayout.of(results[0], segment, inner, tallest_in=1.7)
    foot = 0.78
    height = HEAD_IN + len(results) * strip.with_caption_in + foot
    figure = style.new_figure(WIDTH_IN, height)
    world = results[0].environment.world
    reason = why_notable(results, segment)
    title = f"{world.name}: {shown_label(world, world.segment(segment))}, {reason} of {len(results[0].rows)} segments"
    _heading(figure, title, "same traffic", results[0])
    y = height - HEAD_IN
    looks = style.policy_styles([result.policy for result in results])
    for number, result in enumerate(results):
        y -= strip.caption_in
        _caption(figure, (MARGIN_IN, y), result, strip, result.policy, looks[result.policy].colour)
        y -= strip.height_in
        draw_strip(figure, strip, result, (MARGIN_IN, y), scale=number == 0)
        y -= GAP_IN
    foot_axes = style.panel(figure, MARGIN_IN, 0.08, inner, foot - 0.12)
    handles, labels = legend_of(results, town=False)
    foot_axes.legend(
        handles, labels, loc="center left", ncols=4, handler_map={tuple: HandlerTuple(ndivide=None)}, borderpad=0,
        bbox_to_anchor=(0, 0.5), columnspacing=1.4, handlelength=1.8,
    )  # fmt: skip
    visibility_ramp(foot_axes, (0.80, 0.45, 0.19, 0.15), results[0].settings.visibility.threshold)
    return figure


def flown_bounds(result: MissionResult) -> Bounds:
    """Extent of a map of the mission: the route, the inspected segments and some ground around them, in metres."""
    world = result.environment.world
    route = np.column_stack([result.track["x_m"], result.track["y_m"]])
    shown: list[shapely.Geometry] = [world.segment(row.segment).polygon for row in result.rows]
    shown += [world.base, shapely.MultiPoint(route)]
    west, south, east, north = (float(value) for value in shapely.total_bounds(shown))
    return west - AROUND_M, south - AROUND_M, east + AROUND_M, north + AROUND_M


def _draw_town(axes: Axes, result: MissionResult, bounds: Bounds, strips: Sequence[SegmentLayout]) -> None:
    draw_world(axes, result.environment.world, bounds=bounds, layers=_QUIET, defects=False, muted=True)
    weights = mission_layers.TOWN.times(float(np.clip(shapes.points_per_m(axes), 0.45, 1.0)))
    for strip, letter in zip(strips, "abc", strict=False):
        frame = shapely.get_coordinates(strip.outline().intersection(shapely.box(*bounds)))
        shapes.strokes(axes, [frame], ABOVE_WORLD + 27, style.INK, 0.8, (3.2, 1.6))
        corner = frame[int(np.argmax(frame[:, 1] - frame[:, 0]))]
        disc = {"boxstyle": "circle,pad=0.18", "facecolor": style.PAPER, "edgecolor": style.INK, "linewidth": 0.8}
        text = axes.text(float(corner[0]), float(corner[1]), letter, fontsize=9, fontweight="bold", bbox=disc)
        text.set(ha="center", va="center", zorder=ABOVE_WORLD + 40)
    inspected = {row.segment for row in result.rows}
    name_streets(axes, result.environment.world, inspected, [strip.outline() for strip in strips])
    mission_layers.draw_surfaces(axes, result, _PLAIN)
    mission_layers.draw_parked(axes, result, _PLAIN)
    mission_layers.draw_route(axes, result, _PLAIN, weights)
    mission_layers.draw_defects(axes, result, _PLAIN, weights)
    mission_layers.draw_reactions(axes, result, _PLAIN, weights, [strip.outline() for strip in strips])
    mission_layers.draw_stations(axes, result, _PLAIN)


def name_streets(axes: Axes, world: World, inspected: Collection[str], frames: Sequence[shapely.Polygon] = ()) -> None:
    """Write street names outside the inspected segments and frames where the street continues there, else across
    them."""
    segments, names = world.segments, shown_names(world)
    per_m = shapes.points_per_m(axes)
    base = world.base.buffer(6.0 / per_m)
    clear, any_ = lettering.OccupiedSpace(), lettering.OccupiedSpace()
    around = [frame.buffer(_AROUND_FRAME_PT / per_m) for frame in frames]
    kept_clear = (base, *around, *(segment.polygon for segment in segments if segment.id in inspected))
    for place in kept_clear:
        clear.take(place)
    hidden = lettering.write_street_names(axes, world, segments, clear, style.INK_SOFT, mission_layers.NAMES)
    for written in (base, *clear.taken[len(kept_clear) :]):
        any_.take(written)
    rest = [segment for segment in segments if names[segment.id] in hidden]
    lettering.write_street_names(axes, world, rest, any_, style.INK_SOFT, mission_layers.NAMES)


def _draw_side(axes: Axes, result: MissionResult, inches_per_m: float, *, narrow: bool) -> None:
    """Numbers and legend, side by side if the width allows, and the scale below; coordinates are inches."""
    (_, width_in), (_, height) = axes.get_xlim(), axes.get_ylim()
    width = SIDE_IN - 0.2
    y = height - 0.08
    for name, value in main_numbers(result):
        axes.text(0, y, name, fontsize=8, color=style.INK_SOFT, va="top")
        axes.text(width, y, value, fontsize=8, fontweight="bold", ha="right", va="top")
        axes.plot([0, width], [y - 0.165, y - 0.165], color="#E5E2DC", linewidth=0.5)
        y -= 0.205
    left, y = (width + 0.35, height - 0.06) if narrow else (0.0, y - 0.1)
    handles, labels = legend_of([result], town=True)
    axes.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(left / width_in, y / height), borderpad=0, borderaxespad=0,
        handler_map={tuple: HandlerTuple(ndivide=None)}, labelspacing=0.62, handlelength=2.0, fontsize=8,
    )  # fmt: skip
    y -= LEGEND_ROW_IN * len(handles) + 0.36
    box = (left / width_in, y / height, width / width_in, 0.1 / height)
    visibility_ramp(axes, box, result.settings.visibility.threshold)
    style.scale_bar(axes, left + 1.7, y - 0.62, inches_per_m, longest=1.6)
    style.north_arrow(axes, left + 2.05, y - 0.53)


def _heading(figure: Figure, title: str, what: str, result: MissionResult) -> None:
    """Title, `what` and how it was flown, and whom the world's data come from."""
    world, (across, along) = result.environment.world, window_m(result.settings)
    parts = [what, f"altitude {result.environment.altitude_m:g} m"]
    parts += [_traffic_words(result)] if result.traffic else []
    parts += [result.settings.pattern.kind.replace("_", " "), f"window {across:.1f} × {along:.1f} m"]
    parts += [f"sensor {result.sensor}", f"seed {result.seed}"]
    width, height = figure.get_size_inches()
    left, right = MARGIN_IN / width, 1 - MARGIN_IN / width
    figure.text(left, 1 - 0.14 / height, title, fontsize=14, fontweight="bold", va="top")
    figure.text(left, 1 - 0.40 / height, "  ·  ".join(parts), fontsize=8.5, color=style.INK_SOFT, va="top")
    if world.folder is not None and world.folder.is_dir():
        named = credit(world) or ""
        figure.text(right, 1 - 0.04 / height, named, fontsize=6.5, color=style.INK_SOFT, ha="right", va="top")


def _traffic_words(result: MissionResult) -> str:
    """`traffic los-D instead of los-C (LOS D, 17 km/h)`; with its seed where the mission has another."""
    traffic = result.spec.traffic
    name = f"traffic {traffic.density or USER}"
    instead = f" instead of {traffic.instead_of}" if traffic.instead_of else ""
    seed = f", seed {traffic.seed}" if traffic.seed != result.seed else ""
    flow = f" ({result.flow.short})" if result.flow and result.flow.short else ""
    return f"{name}{seed}{instead}{flow}"


def _label(result: MissionResult, segment: str) -> str:
    world = result.environment.world
    return shown_label(world, world.segment(segment))


def _caption(
    figure: Figure, corner_in: tuple[float, float], result: MissionResult, strip: SegmentLayout, head: str, colour: str
) -> None:
    """Above a strip whose upper left is `corner_in`: which segment, and what happened there."""
    row = next(row for row in result.rows if row.segment == strip.segment)
    (width, height), (left, bottom) = figure.get_size_inches(), corner_in
    words = [caption(row)] if head == result.policy else [_label(result, row.segment), caption(row)]
    two_lines = strip.caption_in > CAPTION_IN
    y = bottom + 0.07
    if two_lines and len(words) == 2:
        figure.text(left / width, y / height, words.pop(), fontsize=7.5, color=style.INK, va="baseline")
        y += 0.16
    bold = figure.text(left / width, y / height, head, fontsize=9.5, fontweight="bold", color=colour, va="baseline")
    bold.set_fontfamily(families(head))
    end = bold.get_window_extent().x1 / figure.dpi
    figure.text((end + 0.1) / width, y / height, "  ·  ".join(words), fontsize=8, va="baseline")
