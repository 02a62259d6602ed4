"""24 streets of several towns from the air: generated ones and, where there are maps, real ones."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from PIL import Image
from shapely import Point

from gallery.renderer import LOW_SUN, MORNING, OVERCAST, SEED, GalleryRenderer, Picture
from gallery.sheet import captioned, grid
from pavetwin.cli.demo import TOWN_SEED
from pavetwin.scene.ground import GroundPlan, plan_ground
from pavetwin.scene.ground.looks import mark, street_look
from pavetwin.scene.view import look
from pavetwin.world.build import BuildOptions
from pavetwin.world.model import Segment
from pavetwin.world.segments import direction_at

STREETS: Final = 24
ALTITUDE_M: Final = 10.0
SHOWN_M: Final = (9.6, 7.2)
"""Of each street, across and along."""
TAKEN_PX: Final = (640, 480)
CELL_PX: Final = (320, 240)
IN_SIGHT_M: Final = 3.5
"""Half of what is shown along a street."""
SHORTEST_M: Final = 40.0
"""Streets below are mostly stubs at the border of a map."""
FROM_END_M: Final = 5.0
"""Of the places before junctions, where most markings are."""
LEAST_WIDTH_M: Final = 0.012
"""Of damage that is seen at 30 mm a pixel, as lines somewhat darker than their surroundings."""
BESIDE_M: Final = 8.0
"""A crossing nearer to a segment's line than this is at its end."""
ASIDE_M: Final = 2.0
"""From the middle line towards damage, at most half of the way."""
SHIFT_M: Final = 1.5
"""From the middle of a crossing towards its street."""
LEAST_BARS: Final = 2
"""Of a painted crossing: some are only kerbs that are lowered."""
BUS_STOP: Final = "bus_stop"


@dataclass(frozen=True)
class Town:
    """A town of the sheet."""

    title: str
    renderer: GalleryRenderer
    streets: int
    phase: float = 0.25
    """Which of its streets, 0 … 1: two towns of one map show different ones."""


def towns(renderer: GalleryRenderer) -> list[Town]:
    """Two generated towns under two marking standards; half of the streets are real where there are maps: Seattle, and
    Berlin as it is and with traffic that keeps left."""
    folder, maps = renderer.folder, renderer.maps
    share = 5 if maps else 12
    china = GalleryRenderer.with_markings(folder / "china", "china")
    china.options = BuildOptions(seed=TOWN_SEED + 1)
    found = [
        Town("generated, markings of Germany", renderer, share),
        Town("generated, markings of China", china, share, 0.75),
    ]
    if not maps:
        return found
    berlin, seattle = maps / "berlin_neukoelln.osm", maps / "seattle_roosevelt.osm"
    left = GalleryRenderer.with_markings(folder / "berlin-left", "united_kingdom")
    left.source, left.options = berlin, BuildOptions(left_hand=True)
    rule = BuildOptions(parking_rule="north_america")
    return [
        *found,
        Town("Seattle", GalleryRenderer(folder / "seattle", source=seattle, options=rule), 6),
        Town("Berlin", GalleryRenderer(folder / "berlin", source=berlin, options=BuildOptions()), 4),
        Town("Berlin, keeping left, markings of the UK", left, 4, 0.75),
    ]


def streets(renderer: GalleryRenderer) -> Picture:
    """Streets of several towns as the UAV sees them, half of them where damage is largest, the others at a crossing, a
    bus stop or before a junction, under changing skies; each sky has one exposure, so that pale streets are pale and
    dark ones dark."""
    whole = grid([cell for town in towns(renderer) for cell in _cells(town)], columns=4)
    note = f"{1000 * SHOWN_M[0] / CELL_PX[0]:.0f} mm a pixel."
    if renderer.maps:
        note += " Maps of Seattle and Berlin: © OpenStreetMap contributors, ODbL (openstreetmap.org/copyright)"
    return captioned(whole, note, height_px=whole.shape[0])


def _cells(town: Town) -> Iterator[Picture]:
    """One cell a street: the places are shown in turn, each on a street that has one and is not shown yet."""
    renderer = town.renderer
    plan = plan_ground(renderer.world, SEED, look=street_look(renderer.look))
    long = [each for each in renderer.world.segments if each.length_m >= SHORTEST_M]
    unused = sorted({each.street for each in long})
    for index in range(min(town.streets, len(unused))):
        for choose in (PLACES[index % len(PLACES)], *PLACES):
            best: dict[str, _Place] = {}
            for segment in long:
                for place in choose(plan, segment) if segment.street in unused else ():
                    best[segment.street] = max(place, best.get(segment.street, place))
            if best:
                break
        name = sorted(best)[int((town.phase + index * 0.618034) % 1 * len(best))]
        unused.remove(name)
        place = best[name]
        view = look(
            (place.x_m, place.y_m, ALTITUDE_M),
            yaw_rad=place.yaw_rad,
            pitch_rad=-math.pi / 2,
            size_px=TAKEN_PX,
            vertical_fov_rad=2 * math.atan(SHOWN_M[1] / 2 / ALTITUDE_M),
        )
        light = (OVERCAST, MORNING, OVERCAST, LOW_SUN, MORNING)[index % 5]
        taken = Image.fromarray(renderer.take(view, light, exposure=renderer.grey_card(light)))
        cell = np.asarray(taken.resize(CELL_PX, Image.Resampling.LANCZOS))
        yield captioned(cell, town.title, height_px=CELL_PX[1])


@dataclass(frozen=True, order=True)
class _Place:
    """What a camera looks down on; the greatest is the one with most damage that can be seen."""

    damage_m2: float
    segment: str
    x_m: float
    y_m: float
    yaw_rad: float


def _place(plan: GroundPlan, segment: Segment, at: Point) -> _Place:
    """A place on a segment, or near it, with the area of wide damage in sight there."""
    line = segment.centre_line
    dx, dy = direction_at(line, line.project(at))
    sight = at.buffer(IN_SIGHT_M)
    wide = (each for each in plan.world.defects_of(segment.id) if each.width_m >= LEAST_WIDTH_M)
    damage = sum(each.area_m2 for each in wide if sight.contains(each.centre))
    return _Place(damage, segment.id, at.x, at.y, math.atan2(dy, dx))


def _damaged(plan: GroundPlan, segment: Segment) -> Iterator[_Place]:
    """At each defect, towards the middle line; and in the middle."""
    line = segment.centre_line
    for each in plan.world.defects_of(segment.id):
        along = line.interpolate(line.project(each.centre))
        share = min(0.5, ASIDE_M / max(along.distance(each.centre), ASIDE_M))
        x, y = (low + share * (high - low) for low, high in zip(along.coords[0], each.centre.coords[0], strict=True))
        yield _place(plan, segment, Point(x, y))
    yield _place(plan, segment, line.interpolate(line.length / 2))


def _before_junction(plan: GroundPlan, segment: Segment) -> Iterator[_Place]:
    for station in (FROM_END_M, segment.length_m - FROM_END_M):
        yield _place(plan, segment, segment.centre_line.interpolate(station))


def _at_crossing(plan: GroundPlan, segment: Segment) -> Iterator[_Place]:
    """At painted crossings at an end of a segment, with some of the street before them."""
    line, bars = segment.centre_line, plan.paint.bars[~plan.paint.is_former]
    for crossing in plan.world.crossings:
        middle = crossing.polygon.centroid
        if line.distance(middle) > BESIDE_M:
            continue
        painted = int(shapely.contains_xy(crossing.polygon.buffer(0.5), bars[:, :2]).sum())
        if painted >= LEAST_BARS:
            ahead = line.interpolate(min(max(line.project(middle), BESIDE_M), line.length - BESIDE_M))
            share = SHIFT_M / max(middle.distance(ahead), SHIFT_M)
            at = Point(middle.x + share * (ahead.x - middle.x), middle.y + share * (ahead.y - middle.y))
            yield _place(plan, segment, at)


def _at_bus_stop(plan: GroundPlan, segment: Segment) -> Iterator[_Place]:
    """At the words of bus stops: the long side of their cage is the longest stroke of all marks."""
    stop = mark(BUS_STOP)
    length_m = max(float(np.abs(np.diff(stroke, axis=0)).max()) for stroke in map(np.array, stop.strokes))
    bars = plan.paint.bars
    cages = np.isclose(2 * bars[:, 3], length_m, atol=stop.width_m) & np.isclose(2 * bars[:, 4], stop.width_m)
    for x, y in bars[cages, :2].tolist():
        if segment.polygon.contains(Point(x, y)):
            yield _place(plan, segment, Point(x, y))


PLACES: Final = (_damaged, _at_crossing, _damaged, _at_bus_stop, _damaged, _before_junction)
"""In turn, where a street has them."""
