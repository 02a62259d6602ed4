"""Streets cut into segments, the units of inspection (S = {s_1 … s_N}).

A street is cut across into the fewest equal pieces of at most `segment_length`. The pieces tile its carriageway;
the cuts are perpendicular to the centre line.
"""

import math
import zlib
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.ops import split, substring

from pavetwin.world.model import Segment, Surface, World
from pavetwin.world.streets import StreetSurface, polygons_of, surface_of

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
        for line, polygon in pieces_of(street, segment_length_m):
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


def pieces_of(street: StreetSurface, segment_length_m: float) -> Iterator[tuple[LineString, Surface]]:
    """The pieces of a street's centre line, each with its part of the carriageway."""
    count = math.ceil(street.length_m / segment_length_m - 1e-9)
    return equal_pieces(street.centre_line, street.polygon, count)


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
    """How much of the carriageway belongs to no segment."""
    outside_m2, whole_m2 = world.outside_segments_m2, world.carriageway.area
    return f"{outside_m2:.0f} m² of junctions and crossings, {100 * outside_m2 / whole_m2:.0f} % of the carriageway"
