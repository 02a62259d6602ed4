"""Streets of a network, and their segments, the units of inspection (S = {s_1 … s_N}).

A street joins the directed edges of a road to one carriageway, with a centre line and a polygon. The carriageway is the
driving and bicycle lanes; sidewalks are not part of it. A street is cut across into the fewest equal pieces of at most
`segment_length`. The pieces tile its carriageway; the cuts are perpendicular to the centre line.
"""

import math
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon, STRtree
from shapely.ops import split, substring

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Lane, LaneKind, Segment, Street, Surface, World
from pavetwin.world.roadnet import Edge, RoadNet

MAX_MEDIAN_M = 3.0
"""Two directions further apart than this are two streets with a median between them [m]."""

MIN_STREET_M = 8.0
"""A shorter street counts as part of a junction and is not inspected [m]."""

CLOSING_M = 0.3
"""Slivers between neighbouring lanes up to twice this are closed [m]."""


@dataclass(frozen=True, slots=True)
class StreetSurface:
    """A street with its edges as the network has them and the polygon of its carriageway."""

    street: Street
    edges: tuple[Edge, ...]
    polygon: Surface

    @property
    def centre_line(self) -> LineString:
        return self.street.centre_line

    @property
    def length_m(self) -> float:
        return self.street.length_m

    @property
    def lanes(self) -> int:
        return sum(lane.kind is LaneKind.DRIVING for edge in self.edges for lane in edge.lanes)


def streets_of(net: RoadNet) -> tuple[StreetSurface, ...]:
    """All streets for cars of at least 8 m, by name and then along its main direction; polygons are disjoint."""
    streets = [_street(edges, net.left_hand) for edges in pair_edges(net.edges.values())]
    kept = [street for street in streets if street.length_m >= MIN_STREET_M and street.polygon.area > 0]
    return _disjoint(_in_order(kept))


def pair_edges(edges: Iterable[Edge]) -> list[tuple[Edge, ...]]:
    """Each street's directed edges: two when the reverse one runs next to it (a median of at most 3 m), else one."""
    open_edges = {edge.id: edge for edge in edges if edge.for_cars and edge.carriageway}
    between: dict[tuple[str, str], list[Edge]] = {}
    for edge in open_edges.values():
        between.setdefault((edge.start, edge.end), []).append(edge)
    pairs: list[tuple[Edge, ...]] = []
    # OSM's own direction (`12#1`) before the reverse one (`-12#1`), so that a street runs as it was drawn.
    for name in sorted(open_edges, key=lambda name: (name.removeprefix("-"), name.startswith("-"))):
        if name not in open_edges:
            continue
        edge = open_edges.pop(name)
        beside = [
            (_median_m(edge, other), other.id)
            for other in between.get((edge.end, edge.start), [])
            if other.id in open_edges
        ]
        gap, partner = min(beside, default=(math.inf, ""))
        pairs.append((edge, open_edges.pop(partner)) if gap <= MAX_MEDIAN_M else (edge,))
    return pairs


def _median_m(edge: Edge, other: Edge) -> float:
    """Width of the strip between two opposite edges' innermost lanes [m]; infinite when they are not adjacent."""
    inner, facing = edge.carriageway[-1], other.carriageway[-1]
    if not 0.6 <= inner.length_m / facing.length_m <= 1.0 / 0.6 and abs(inner.length_m - facing.length_m) > 10.0:
        return math.inf
    count = _sample_count(inner)
    apart = np.hypot(*(_sample(inner, count) - _sample(facing, count)[::-1]).T)
    return float(np.median(apart)) - (inner.width_m + facing.width_m) / 2


def _street(edges: tuple[Edge, ...], left_hand: bool) -> StreetSurface:
    first = edges[0]
    ids = tuple(edge.id for edge in edges)
    lanes = [lane for edge in edges for lane in edge.carriageway]
    gap = max(0.0, _median_m(*edges)) if len(edges) == 2 else 0.0
    street = Street(
        id=" ".join(ids),
        name=first.name or first.id.removeprefix("-"),
        kind=first.type,
        edges=ids,
        start=first.start,
        end=first.end,
        centre_line=middle_line(edges, left_hand),
    )
    return StreetSurface(street, edges, lanes_polygon(lanes, CLOSING_M + gap / 2))


def lanes_polygon(lanes: Sequence[Lane], closing_m: float = CLOSING_M) -> Surface:
    """Union of lanes with flat ends; gaps of up to twice `closing_m` between them are closed, holes filled."""
    strips = [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat", join_style="mitre") for lane in lanes]
    closed = union_of(strips, closing_m).buffer(-closing_m, join_style="mitre")
    return surface_of([Polygon(part.exterior) for part in polygons_of(closed)])


def union_of(surfaces: Iterable[Surface], wider_m: float) -> Surface:
    """Union of surfaces that are each widened first.

    They overlap then. GEOS may lose a polygon whose border nearly coincides with its neighbour's, as lanes' borders do.
    """
    union = shapely.union_all([surface.buffer(wider_m, join_style="mitre") for surface in surfaces])
    assert isinstance(union, Polygon | MultiPolygon)
    return union


def surface_of(parts: Sequence[Polygon]) -> Surface:
    """One polygon or several; parts below 0.5 m² are dropped unless nothing else is there."""
    large = [part for part in parts if part.area >= 0.5] or list(parts)
    return large[0] if len(large) == 1 else MultiPolygon(large)


def polygons_of(geometry: shapely.Geometry) -> list[Polygon]:
    """The polygons in any geometry, largest first."""
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return sorted((part for part in parts if isinstance(part, Polygon) and part.area > 0), key=lambda part: -part.area)


def middle_line(edges: tuple[Edge, ...], left_hand: bool) -> LineString:
    """Middle of the carriageway: half-way between its two outer borders, at equal shares of their lengths."""
    near = edges[0].carriageway[0]
    far = edges[1].carriageway[0] if len(edges) == 2 else edges[0].carriageway[-1]
    count = _sample_count(near)
    along = _sample(near, count)
    opposite = _sample(far, count)[::-1] if len(edges) == 2 else _sample(far, count)
    side = 1.0 if left_hand else -1.0
    border = along + side * near.width_m / 2 * left_normals(along)
    other = opposite - side * far.width_m / 2 * left_normals(opposite)
    middle = LineString((border + other) / 2).simplify(0.03)
    assert isinstance(middle, LineString)
    return middle


def left_normals(points: Float64Array) -> Float64Array:
    """Unit normals (n, 2) to the left of a line of points (n, 2)."""
    tangent = np.gradient(points, axis=0)
    length = np.hypot(tangent[:, 0], tangent[:, 1])
    tangent /= np.where(length > 0, length, 1.0)[:, None]
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def _sample_count(lane: Lane) -> int:
    return max(2, math.ceil(lane.length_m) + 1)


def _sample(lane: Lane, count: int) -> Float64Array:
    shares = np.linspace(0.0, 1.0, count)
    points = shapely.line_interpolate_point(lane.centre_line, shares, normalized=True)
    return np.asarray(shapely.get_coordinates(points), dtype=np.float64)


def _in_order(streets: list[StreetSurface]) -> list[StreetSurface]:
    """Sort streets by name; those of one name from west to east along the line through them (south to north when that
    is steep)."""
    by_name: dict[str, list[StreetSurface]] = {}
    for street in streets:
        by_name.setdefault(street.street.name, []).append(street)
    ordered: list[StreetSurface] = []
    for name in sorted(by_name):
        middles = np.array([street.centre_line.centroid.coords[0] for street in by_name[name]])
        spread = middles.max(axis=0) - middles.min(axis=0)
        axis = 0 if spread[0] >= spread[1] else 1
        keyed = [
            (round(float(middle[axis]), 2), street.edges[0].id, street)
            for middle, street in zip(middles, by_name[name], strict=True)
        ]
        ordered += [street for *_, street in sorted(keyed, key=lambda item: item[:2])]
    return ordered


def _disjoint(streets: list[StreetSurface]) -> tuple[StreetSurface, ...]:
    """Cut off what an earlier street covers already: lanes overlap where SUMO's streets meet at a sharp angle."""
    tree = STRtree([street.polygon for street in streets])
    result: list[StreetSurface] = []
    for index, street in enumerate(streets):
        earlier = [result[other].polygon for other in tree.query(street.polygon, "intersects") if other < index]
        overlapping = [other for other in earlier if street.polygon.intersection(other).area > 0.01]
        if overlapping:
            surface = surface_of(polygons_of(street.polygon.difference(union_of(overlapping, 1e-3))))
            if surface.area < 0.5:
                continue
            street = replace(street, polygon=surface)
        result.append(street)
    return tuple(result)


DEFAULT_SEGMENT_LENGTH_M = 135.0
MIN_SEGMENT_LENGTH_M = 20.0
"""No piece is shorter, unless its whole street is [m]."""


def segments_of(
    streets: Iterable[StreetSurface], segment_length_m: float = DEFAULT_SEGMENT_LENGTH_M
) -> tuple[Segment, ...]:
    """Segments `s0001` … in the order of the streets, and along each street's centre line.

    Raises:
        ValueError: `segment_length_m` is below 40, so that equal pieces could fall below 20 m.
    """
    if segment_length_m < 2 * MIN_SEGMENT_LENGTH_M:
        raise ValueError(f"a segment length of {segment_length_m:g} m is below {2 * MIN_SEGMENT_LENGTH_M:g} m")
    segments: list[Segment] = []
    for street in streets:
        count = math.ceil(street.length_m / segment_length_m - 1e-9)
        for line, polygon in equal_pieces(street.centre_line, street.polygon, count):
            segments.append(
                Segment(
                    id=f"s{len(segments) + 1:04d}",
                    street=street.street.name,
                    edges=street.street.edges,
                    centre_line=line,
                    polygon=polygon,
                    width_m=round(float(polygon.area) / line.length, 3),
                    lanes=street.lanes,
                )
            )
    return tuple(segments)


def equal_pieces(centre_line: LineString, polygon: Surface, count: int) -> Iterator[tuple[LineString, Surface]]:
    """Pieces of equal length of a carriageway, each with its part of the centre line, in the order along it.

    The cuts are perpendicular to the centre line; a piece that has no surface is left out.
    """
    if count <= 1:
        yield centre_line, polygon
        return
    length_m = centre_line.length
    stations = np.linspace(0.0, length_m, count + 1)
    lines = [LineString(substring(centre_line, a, b).coords) for a, b in pairwise(stations)]
    shares: list[list[Polygon]] = [[] for _ in lines]
    for part in _cut(centre_line, polygon, stations[1:-1]):
        along = centre_line.project(part.representative_point())
        shares[min(count - 1, int(along / length_m * count))].append(part)
    for line, parts in zip(lines, shares, strict=True):
        if parts:
            yield line, parts[0] if len(parts) == 1 else _joined(parts)


def _joined(parts: list[Polygon]) -> Surface:
    """Touching parts as one surface, none lost."""
    union = shapely.union_all(parts)
    area = sum(part.area for part in parts)
    return surface_of(polygons_of(union) if abs(union.area - area) < 1e-6 * area else parts)


def _cut(centre_line: LineString, polygon: Surface, stations: Iterable[float]) -> list[Polygon]:
    """The polygons of a carriageway, cut across at the stations (metres along its centre line)."""
    reach = shapely.hausdorff_distance(polygon.boundary, centre_line) + 1.0
    parts = polygons_of(polygon)
    for station in stations:
        knife = cross_line(centre_line, station, reach)
        parts = [piece for part in parts for piece in polygons_of(split(part, knife))]
    return parts


def cross_line(line: LineString, station_m: float, reach_m: float) -> LineString:
    """A straight line perpendicular to `line` at a station, `reach_m` to the left (its start) and to the right."""
    x, y = point_at(line, station_m)
    dx, dy = direction_at(line, station_m)
    return LineString([(x - dy * reach_m, y + dx * reach_m), (x + dy * reach_m, y - dx * reach_m)])


def point_at(line: LineString, station_m: float) -> tuple[float, float]:
    """The point (x, y) at a station [m]."""
    point = shapely.line_interpolate_point(line, station_m)
    return float(point.x), float(point.y)


def direction_at(line: LineString, station_m: float, over_m: float = 2.0) -> tuple[float, float]:
    """Unit direction (dx, dy) of a line at a station, averaged over `over_m` to smooth single vertices."""
    low = max(0.0, min(station_m - over_m / 2, line.length - over_m))
    high = min(line.length, max(station_m + over_m / 2, over_m))
    (ax, ay), (bx, by) = point_at(line, low), point_at(line, high)
    length = math.hypot(bx - ax, by - ay) or 1.0
    return (bx - ax) / length, (by - ay) / length


def segment_key(segment: Segment) -> int:
    """A number that keys the random seeds of a segment; it does not depend on other streets."""
    middle = segment.centre_line.interpolate(0.5, normalized=True)
    return zlib.crc32(f"{' '.join(segment.edges)} {middle.x:.1f} {middle.y:.1f}".encode())


def outside_words(world: World) -> str:
    """Area of the carriageway outside all segments, as text."""
    outside_m2, whole_m2 = world.outside_segments_m2, world.carriageway.area
    return f"{outside_m2:.0f} m² of junctions and crossings, {100 * outside_m2 / whole_m2:.0f} % of the carriageway"
