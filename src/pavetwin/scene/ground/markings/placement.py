"""Road markings of a world: lines, crossings, arrows, parking places, and traces of former markings."""

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Final

import numpy as np
import shapely
import shapely.ops
from shapely import LineString, Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.lines import direction
from pavetwin.scene.ground.layout.paved import Ageing
from pavetwin.scene.ground.layout.streets import Approach, StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.markings.areas import box_lines, corners, hatch, islands
from pavetwin.scene.ground.markings.painter import Paint, Painter
from pavetwin.scene.ground.styles.marking_standard import CrossingKind, MarkingStandard, PaintName
from pavetwin.scene.ground.styles.street_style import FormerKind
from pavetwin.scene.ground.styles.values import pick
from pavetwin.world.model import CARRIAGEWAY_LANES, Crossing, Direction, Lane, LaneKind, World
from pavetwin.world.parking import ParkingOrientation, ParkingPlace, ParkingPosition

LENGTH_M: Final = 5.0
SHAFT_M: Final = 0.15


@cache
def arrow(turns: frozenset[Direction]) -> tuple[Float64Array, ...]:
    """The outline of an arrow whose heads point straight on, left or right.

    (n, 2): x ahead from the shaft's foot, y to the left, metres.
    """
    parts = []
    if Direction.STRAIGHT in turns:
        parts += [_box(0.0, 3.4, 0.0), shapely.Polygon([(3.3, -0.45), (LENGTH_M, 0.0), (3.3, 0.45)])]
    for turn, side in ((Direction.LEFT, 1.0), (Direction.RIGHT, -1.0)):
        if turn in turns:
            parts += _branch(side, 1.4 if Direction.STRAIGHT in turns else 2.6)
            parts.append(_box(0.0, 2.0 if Direction.STRAIGHT in turns else 3.0, 0.0))
    whole = shapely.union_all(parts)
    return tuple(shapely.get_coordinates(shapely.get_exterior_ring(part))[:-1] for part in shapely.get_parts(whole))


def _branch(side: float, at: float) -> list[shapely.Polygon]:
    """A shaft that bends away and its head."""
    bend = [(at, 0.0), (at + 0.55, 0.10), (at + 0.95, 0.40), (at + 1.15, 0.75)]
    shaft = shapely.LineString([(x, side * y) for x, y in bend]).buffer(SHAFT_M, cap_style="flat", quad_segs=3)
    head = [(at + 0.55, 0.62), (at + 1.75, 0.62), (at + 1.35, 1.18)]
    return [shaft, shapely.Polygon([(x, side * y) for x, y in head])]


def _box(start: float, end: float, y: float) -> shapely.Polygon:
    return shapely.box(start, y - SHAFT_M / 2, end, y + SHAFT_M / 2)


SHARED_M: Final = 0.3  # Lines of neighbouring places that are nearer to each other are one [m]
MARGIN_M: Final = 0.1  # The lines end this far before the driven lane [m]
GUTTER_FREE_M: Final = 0.45  # And this far before the kerb, where gutters and grates are [m]


def parking_lines(world: World) -> Iterator[tuple[LineString, ParkingPlace]]:
    """Each line with a place that it ends, in the order of the world's places; metres, world frame."""
    drawn: dict[str, list[tuple[float, float]]] = {}
    for place in world.parking:
        if place.position not in (ParkingPosition.LANE, ParkingPosition.STREET_SIDE):
            continue
        taken = drawn.setdefault(place.street, [])
        middle_line = world.segment(place.segment).centre_line
        for ends in _sides(place):
            kerb, inner = sorted(ends, key=lambda end: -middle_line.distance(Point(end)))
            towards = (inner - kerb) / np.hypot(*(inner - kerb))
            x, y = (kerb + inner) / 2
            if all((x - other[0]) ** 2 + (y - other[1]) ** 2 > SHARED_M**2 for other in taken):
                taken.append((x, y))
                yield LineString([kerb + GUTTER_FREE_M * towards, inner - MARGIN_M * towards]), place


def _sides(place: ParkingPlace) -> Iterator[tuple[Float64Array, Float64Array]]:
    """The ends of the two sides of a place that run across the street."""
    ahead = np.array([np.cos(place.yaw_rad), np.sin(place.yaw_rad)])
    left = np.array([-ahead[1], ahead[0]])
    parallel = place.orientation is ParkingOrientation.PARALLEL
    across, along = (left, ahead) if parallel else (ahead, left)
    reach, apart = (place.width_m, place.length_m) if parallel else (place.length_m, place.width_m)
    centre = np.array([place.centre.x, place.centre.y])
    for side in (-0.5, 0.5):
        middle = centre + side * apart * along
        yield middle - reach / 2 * across, middle + reach / 2 * across


NARROWED: Final = 0.96  # Factor on the width of what is left of a line: its edges wear off first. Ours.
SCAR_M: Final = 0.03  # Removal and masking reach this far to each side of a line. Ours.
AHEAD: Final = 6.0
"""A layout that was given up is moved along its lines by up to this factor on the distance to their side; one that was
painted over by no more than to their side. Ours."""

LEAST_AGE: Final = 0.2  # Newer pavements have no earlier markings
KERB_M: Final = 0.15  # Nothing of it lies nearer to a kerb


def former_kind(plan: SurfaceLayout, name: str) -> FormerKind | None:
    """State of the former markings of a street or a crossing; None where there were none."""
    rules = plan.style.former_markings
    return (
        pick(rules.kinds, plan.chance(f"former kind {name}")) if plan.chance(f"former {name}") < rules.share else None
    )


def left_of(plan: SurfaceLayout, name: str, kind: FormerKind, earlier: Paint) -> Paint:
    """Traces of a former layout.

    Args:
        name: of the street or crossing.
        kind: what became of it.
        earlier: its bars, as if it were today's.
    """
    rules = plan.style.former_markings

    def chance(what: str) -> float:
        return plan.chance(f"former {what} {name}")

    over = kind is FormerKind.OVERPAINTED
    reach = (rules.beside_m if over else rules.moved_m).at(chance("left"))
    left = reach if chance("side") < 0.5 else -reach
    ahead = (1.0 if over else AHEAD) * reach * (2 * chance("ahead") - 1)
    _, _, to_kerb = plan.edges.locate(earlier.bars[:, :2])
    inside = to_kerb > reach + KERB_M
    bars, paints = earlier.bars[inside].copy(), earlier.bar_paints[inside].copy()
    cos, sin = np.cos(bars[:, 2]), np.sin(bars[:, 2])
    bars[:, 0] += ahead * cos - left * sin
    bars[:, 1] += ahead * sin + left * cos
    none = np.zeros((0, 2))
    if kind in (FormerKind.WORN, FormerKind.OVERPAINTED):
        bars[:, 4] *= NARROWED
        paints[:, 1] = rules.wear.at(chance("wear"))
        return Paint(bars, paints, (), none, np.ones(len(bars), dtype=np.bool_), np.zeros((0, 6)))
    bars[:, 3:] += SCAR_M
    tone = (rules.removed_tone if kind is FormerKind.REMOVED else rules.masked_tone).at(chance("tone"))
    scars = np.column_stack([bars, np.full(len(bars), tone)])
    return Paint(np.zeros((0, 5)), none, (), none, np.zeros(0, dtype=np.bool_), scars)


ENDS_FREE_M: Final = 0.6  # Lines end this far before a junction
SOLID_M: Final = 25.0  # Lines between lanes are solid for this far before a stop line (RMS-1: 20 to 30 m in towns)
ARROW_AT_M: Final = (9.0, 27.0)  # Distances of arrows from the stop line
GROOVE_TONE: Final = 0.72  # Factor on the reflectance of a milled groove: dirt in it, and its own shade. Ours.
EDGE_LINE_M: Final = 0.45  # From an edge line's middle to the kerb: clear of a gutter of 30 cm and its grates
MAIN_PARKING_SHARE: Final = 0.8
SIDE_PARKING_SHARE: Final = 0.25
"""Shares of main and of other streets whose places on the carriageway are marked; the first of all with bays. Ours."""

CROSSINGS_OVERLAP_M2: Final = 0.1
"""Crossings that cover each other by more lie in the middle of a junction that the map cut in pieces."""

CROSSING_KERB_M: Final = 4.5
"""Both ends of a crossing lie at most this far from the kerb, which is rounded away where two streets meet."""


def markings(plan: SurfaceLayout, standard: MarkingStandard) -> Paint:
    """All paint of a world."""
    return _Marker(plan, standard).paint()


class _Marker:
    def __init__(self, plan: SurfaceLayout, standard: MarkingStandard) -> None:
        self.plan, self.rules = plan, standard
        self.painter = Painter()
        self.layout = ""
        """Before the names of random choices: empty for today's layout."""
        self.former: list[Paint] = []
        self.crossings = [crossing.polygon for crossing in plan.world.crossings]
        self.crossing_tree = STRtree(self.crossings)
        self.approaches = _approaches(plan)
        self.plans = {street.key: street for street in plan.streets}

    def paint(self) -> Paint:
        stops = {lane: self._stop(lane) for lane in self.approaches}
        for street in self.plan.streets:
            self._street(street, stops)
            if self.plan.ageing(street).age > LEAST_AGE:
                self._before_today(street.name, lambda: self._street(street, stops))  # noqa: B023
        for lane, (approach, turns) in self.approaches.items():
            self._end(approach, turns, stops[lane])
        for index, crossing in enumerate(self.plan.world.crossings):
            if self._is_laid(index):
                self._crossing(crossing)
                self._before_today(crossing.id, lambda: self._crossing(crossing))  # noqa: B023
        self._bicycle_lanes()
        self._areas()
        for line, place in parking_lines(self.plan.world):
            self._parking_line(line, place)
        return self.painter.done().joined(*self.former)

    def _draw(self, what: str) -> float:
        return self.plan.chance(f"{self.layout}marking {what}")

    def _before_today(self, name: str, draw: Callable[[], None]) -> None:
        """Traces of a former layout of a street or a crossing, if it had one."""
        kind = former_kind(self.plan, name)
        if kind is None:
            return
        today, self.painter = self.painter, Painter()
        self.layout = "" if kind is FormerKind.OVERPAINTED else "former "
        draw()
        self.former.append(left_of(self.plan, name, kind, self.painter.done()))
        self.painter, self.layout = today, ""

    def _street(self, street: StreetPlan, stops: dict[str, float]) -> None:
        """The lines along a street."""
        ageing = self.plan.ageing(street)
        two_way = len(street.ways) > 1
        if ageing.unpainted:
            return
        self._kerb_lines(street, ageing)
        if not street.main and self._draw(f"centre {street.name}") >= 0.35:
            return
        for way in street.ways:
            for lane in way[:-1]:
                self._between(lane, stops, ageing)
            inner = way[-1]
            if two_way and way is street.ways[0]:
                self._centre(self._inner_border(inner), street, ageing)
            rules = self.rules
            if not two_way and street.main and rules.left_edge_colour:
                edge = self.plan.world.beside(inner, inner.width_m / 2 - self._to_edge_line(inner, -1))
                self.painter.line(self._clear(edge), rules.line_m, ageing.paint_wear, colour=rules.left_edge_colour)
            if street.main and self._draw(f"edge {street.name}") < rules.edge_share:
                edge = self.plan.world.beside(way[0], self._to_edge_line(way[0], 0) - way[0].width_m / 2)
                self.painter.line(self._clear(edge), rules.line_m, ageing.paint_wear, colour=rules.edge_colour)

    def _kerb_lines(self, street: StreetPlan, ageing: Ageing) -> None:
        """Lines along kerbs where stopping is forbidden, clear of the gutter; none along parking lanes."""
        colour = self.rules.kerb_colour
        if colour is None or street.main or self._draw(f"kerb {street.name}") >= self.rules.kerb_share:
            return
        for way in street.ways:
            to_kerb = self._to_edge_line(way[0], 0)
            if to_kerb:
                edge = self.plan.world.beside(way[0], to_kerb - way[0].width_m / 2)
                self.painter.line(self._clear(edge), self.rules.line_m, ageing.paint_wear, colour=colour)

    def _to_edge_line(self, lane: Lane, end: int) -> float:
        """From a lane's border to the edge line: along the kerb, or on the border of the parking lane there."""
        outermost = self.plan.world.lanes_on(lane.edge, *CARRIAGEWAY_LANES)[end]
        return 0.0 if outermost.kind is LaneKind.PARKING else EDGE_LINE_M

    def _inner_border(self, lane: Lane) -> BaseGeometry:
        """A lane's border towards the middle of its street."""
        return self.plan.world.beside(lane, lane.width_m / 2)

    def _between(self, lane: Lane, stops: dict[str, float], ageing: Ageing) -> None:
        """The line between a lane and the next, solid before a stop line."""
        border = self._inner_border(lane)
        stop = stops.get(lane.id, 0.0)
        near = shapely.intersection(border, self._before(lane, stop, SOLID_M)) if stop else LineString()
        far = shapely.difference(border, self._before(lane, stop, SOLID_M)) if stop else border
        self.painter.line(self._clear(far), self.rules.line_m, ageing.paint_wear, dash_m=self.rules.lane_dash_m)
        self.painter.line(self._clear(near), self.rules.line_m, ageing.paint_wear)

    def _before(self, lane: Lane, stop: float, reach_m: float) -> BaseGeometry:
        """The surroundings of the last metres of a lane before its stop line, and what lies beyond."""
        line = lane.centre_line
        last = shapely.ops.substring(line, max(0.0, stop - reach_m), line.length)
        return last.buffer(lane.width_m * 0.8, cap_style="flat")

    def _centre(self, border: BaseGeometry, street: StreetPlan, ageing: Ageing) -> None:
        """The line between the directions."""
        rules, path = self.rules, self._clear(border)
        many = max(len(way) for way in street.ways) > 1
        solid = many or (street.main and self._draw(f"solid {street.name}") < rules.solid_centre_share)
        if solid and (many or rules.double_solid):
            for side in (-1, 1):
                beside = shapely.offset_curve(path, side * (rules.centre_m + rules.double_gap_m) / 2)
                self.painter.line(beside, rules.centre_m, ageing.paint_wear, colour=rules.centre_colour)
        else:
            dash = None if solid else rules.centre_dash_m
            self.painter.line(path, rules.centre_m, ageing.paint_wear, dash_m=dash, colour=rules.centre_colour)

    def _clear(self, path: BaseGeometry) -> BaseGeometry:
        """A path without its ends at junctions and without crossings."""
        parts = []
        for part in shapely.get_parts(path):
            if isinstance(part, LineString) and part.length > 2 * ENDS_FREE_M:
                inner = shapely.ops.substring(part, ENDS_FREE_M, part.length - ENDS_FREE_M)
                near = [self.crossings[index] for index in self.crossing_tree.query(inner, "dwithin", distance=1.0)]
                parts.append(shapely.difference(inner, shapely.union_all(near).buffer(1.0, join_style="mitre")))
        return shapely.line_merge(shapely.union_all(parts)) if parts else LineString()

    def _stop(self, lane_id: str) -> float:
        """The station of a lane's stop line: before its end, and a metre before a crossing there."""
        line = self.approaches[lane_id][0].lane.centre_line
        station = line.length - ENDS_FREE_M
        for index in self.crossing_tree.query(line, "intersects"):
            first = min(line.project(shapely.Point(xy)) for xy in shapely.get_coordinates(self.crossings[index] & line))
            if first > line.length - 12.0:
                station = min(station, first - 1.0)
        return float(station)

    def _end(self, approach: Approach, turns: frozenset[Direction], station: float) -> None:
        """Markings where a lane meets a junction."""
        lane, street = approach.lane, approach.street
        wear = self.plan.ageing(street).paint_wear
        signalled = approach.junction.kind == "traffic_light"
        if not signalled:
            self._rumble(approach, station, wear)
        if signalled:
            self._across(lane, station, self.rules.stop_m, wear, None)
            if approach.lanes > 1:
                for back in ARROW_AT_M:
                    self._arrow(lane, station - back, turns, wear)
        elif self.plan.gives_way(approach) and self._draw(f"yield {lane.edge}") < (0.85 if street.main else 0.45):
            if self.rules.give_way == "triangles":
                self._triangles(lane, station, wear)
            else:
                self._across(lane, station, self.rules.give_way_m, wear, self.rules.give_way_dash_m)

    def _rumble(self, approach: Approach, station: float, wear: float) -> None:
        """Rumble strips before a junction or a crossing without signals."""
        rules, lane, street = self.rules.rumble, approach.lane, approach.street
        if rules is None or self.plan.ageing(street).unpainted:
            return
        waits = self.plan.gives_way(approach) or station < lane.length_m - ENDS_FREE_M - 0.1
        if not waits or self._draw(f"rumble {lane.edge}") >= (rules.main_share if street.main else rules.other_share):
            return
        on, off = rules.bar_m
        for group in range(rules.groups):
            for bar in range(rules.bars):
                at = station - rules.before_m - group * rules.groups_every_m - bar * (on + off)
                if rules.kind == "painted":
                    self._across(lane, at, on, wear, None, colour=rules.colour)
                else:
                    self._groove(lane, at, on)

    def _groove(self, lane: Lane, station: float, width_m: float) -> None:
        """A groove across a lane, its far edge at a station."""
        if station > width_m + 1.0:
            x, y = lane.centre_line.interpolate(station - width_m / 2).coords[0]
            dx, dy = direction(lane.centre_line, station)
            self.painter.scar((x, y, float(np.arctan2(dx, -dy)), lane.width_m / 2 - 0.25, width_m / 2), GROOVE_TONE)

    def _areas(self) -> None:
        """Hatched areas, and junctions to be kept clear."""
        rules, box = self.rules.hatching, self.rules.box
        streets = {edge: street for street in self.plan.streets for edge in street.street.edges}
        if rules is not None:
            for area, lane, yaw in corners(self.plan):
                ageing = self.plan.ageing(streets[lane.edge])
                end = "end" if lane.centre_line.project(area.centroid) > lane.length_m / 2 else "start"
                if not ageing.unpainted and self._draw(f"corner {lane.id} {end}") < rules.corner_share:
                    hatch(self.painter, area, yaw, rules, ageing.paint_wear)
        approaches = {path.approach.junction.id: path.approach for path in self.plan.paths}
        main = {path.approach.junction.id for path in self.plan.paths if path.approach.street.main}
        for junction in self.plan.world.junctions:
            if junction.id not in approaches:
                continue
            wear = self.plan.ageing(approaches[junction.id].street).paint_wear
            if (
                rules is not None
                and junction.id in main
                and self._draw(f"islands {junction.id}") < rules.junction_share
            ):
                for area, yaw in islands(self.plan, junction):
                    hatch(self.painter, area, yaw, rules, wear)
            if box is not None and junction.kind == "traffic_light" and self._draw(f"box {junction.id}") < box.share:
                box_lines(self.painter, junction, box, wear)

    def _across(
        self,
        lane: Lane,
        station: float,
        width_m: float,
        wear: float,
        dash_m: tuple[float, float] | None,
        *,
        colour: PaintName = "white",
    ) -> None:
        """A bar across a lane, its far edge at a station."""
        if station < width_m + 1.0:
            return
        middle = np.array(lane.centre_line.interpolate(station - width_m / 2).coords[0])
        dx, dy = direction(lane.centre_line, station)
        out = np.array([-dy, dx]) * (lane.width_m / 2 - 0.08)
        self.painter.line(LineString([middle - out, middle + out]), width_m, wear, dash_m=dash_m, colour=colour)

    def _triangles(self, lane: Lane, station: float, wear: float) -> None:
        """A row of triangles across a lane that point against its traffic."""
        (wide, free), high = self.rules.give_way_dash_m, self.rules.give_way_m
        if station < high + 1.0:
            return
        foot = np.array(lane.centre_line.interpolate(station).coords[0])
        dx, dy = direction(lane.centre_line, station)
        ahead, left = np.array([dx, dy]), np.array([-dy, dx])
        count = int((lane.width_m - 0.2 + free) / (wide + free))
        for number in range(count):
            middle = foot + left * ((number - (count - 1) / 2) * (wide + free))
            corners = [middle + left * wide / 2, middle - ahead * high, middle - left * wide / 2]
            self.painter.outline(np.array(corners), wear)

    def _arrow(self, lane: Lane, station: float, turns: frozenset[Direction], wear: float) -> None:
        if station < 6.0 or not turns:
            return
        base = lane.centre_line.interpolate(station - 5.0)
        dx, dy = direction(lane.centre_line, station - 2.5)
        turned = np.array([[dx, dy], [-dy, dx]])
        for ring in arrow(turns):
            self.painter.outline(ring @ turned + (base.x, base.y), wear)

    def _is_laid(self, index: int) -> bool:
        """Whether a crossing leads from kerb to kerb, and no other of at least about its size crosses it.

        Mapped roundabouts of a few metres and junctions of several nodes have crossings between their own pieces.
        """
        shape = self.crossings[index]
        for other in self.crossing_tree.query(shape, "intersects"):
            rival = self.crossings[int(other)]
            covered = other != index and shapely.intersection(shape, rival).area > CROSSINGS_OVERLAP_M2
            if covered and rival.area > 0.8 * shape.area:
                return False
        ring = _outline(shape)
        _, _, away = self.plan.edges.locate(np.array([(ring[0] + ring[1]) / 2, (ring[2] + ring[3]) / 2]))
        return bool((away < CROSSING_KERB_M).all())

    def _crossing(self, crossing: Crossing) -> None:
        """Stripes, two lines or both, or nothing at all."""
        ring = _outline(crossing.polygon)
        wide, way = ring[1] - ring[0], ring[2] - ring[1]
        width, length = float(np.hypot(*wide)), float(np.hypot(*way))
        if width < 1.0 or length < 2.0:
            return
        rules = self.rules
        wear = 0.06 + 0.74 * self._draw(f"crossing wear {crossing.id}") ** 1.6
        shares = rules.signalled if crossing.signalled else rules.unsignalled
        kind = pick(shares, self._draw(f"crossing {crossing.id}"))
        if kind in (CrossingKind.LINES, CrossingKind.LADDER):
            for edge in (0.15 / width, 1.0 - 0.15 / width):
                path = LineString([ring[0] + wide * edge + way * (0.2 / length), ring[3] + (ring[2] - ring[3]) * edge])
                dash = rules.crossing_dash_m
                self.painter.line(path, rules.crossing_line_m, wear, dash_m=dash, colour=rules.crossing_colour)
        if kind in (CrossingKind.STRIPES, CrossingKind.LADDER):
            on, off = rules.stripe_m
            count = int((length - 0.2 + off) / (on + off))
            first = (length - count * (on + off) + off) / 2 + on / 2
            for stripe in range(count):
                foot = ring[1] + way * ((first + stripe * (on + off)) / length)
                own = min(0.92, wear * (0.85 + 0.3 * self._draw(f"stripe {crossing.id} {stripe}")))
                start, end = foot - wide * (1 - 0.1 / width), foot - wide * (0.1 / width)
                self.painter.bar(start, end, on, own, colour=rules.crossing_colour)

    def _parking_line(self, line: LineString, place: ParkingPlace) -> None:
        """At the end of a parking place."""
        plan = self.plans[place.street]
        ageing = self.plan.ageing(plan)
        in_bay = place.position is ParkingPosition.STREET_SIDE
        share = MAIN_PARKING_SHARE if plan.main or in_bay else SIDE_PARKING_SHARE
        if self._draw(f"parking {plan.name}") < share and not ageing.unpainted:
            self.painter.line(line, self.rules.line_m, ageing.paint_wear)

    def _bicycle_lanes(self) -> None:
        """A broad line between a bicycle lane and its neighbour."""
        for lane in self.plan.world.lanes_of(LaneKind.BICYCLE):
            border = self._inner_border(lane)
            self.painter.line(self._clear(border), self.rules.broad_m, 0.3)


def _outline(crossing: Polygon) -> Float64Array:
    """(5, 2) of a crossing: SUMO draws it from one end of its middle line, so its first side is as wide as it is."""
    ring = shapely.get_coordinates(crossing)
    return ring if len(ring) == 5 else shapely.get_coordinates(crossing.minimum_rotated_rectangle)


def _approaches(plan: SurfaceLayout) -> dict[str, tuple[Approach, frozenset[Direction]]]:
    """Every lane that ends at a junction, and which ways lead on from it."""
    found: dict[str, tuple[Approach, frozenset[Direction]]] = {}
    for path in plan.paths:
        lane = path.approach.lane.id
        turns: Iterable[Direction] = found[lane][1] if lane in found else ()
        found[lane] = (path.approach, frozenset({*turns, path.turn}))
    return found
