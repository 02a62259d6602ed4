"""Parking bays and gutters along the kerbs of carriageways."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.lines import ways_along
from pavetwin.world.model import Segment, World
from pavetwin.world.parking import ParkingPosition
from pavetwin.world.pavement_joints import GUTTER_M, has_gutter

MARGIN_M: Final = 0.2  # A bay reaches this far beyond its places: ours
GAP_M: Final = 2.0
"""Bays are joined to the carriageway and to each other over gaps of up to this width: ours."""

BEHIND_M: Final = 2.0
"""Width of the pavement behind a bay, which the bay takes from the sidewalk at the carriageway: ours."""


def bays_of(world: World) -> BaseGeometry:
    """The bays of a world: its places at the street's side, joined to the carriageway, without that; world frame.

    Empty where no place lies in a bay.
    """
    places = in_bays(world)
    if not places:
        return Polygon()
    wide = shapely.union_all([shape for shape, _ in places]).buffer(MARGIN_M, join_style="mitre")
    near = shapely.intersection(world.carriageway, wide.buffer(GAP_M, quad_segs=2))
    joined = _closed(shapely.union(wide, near))
    beside = shapely.intersection(joined, wide.buffer(GAP_M, join_style="mitre"))
    return _areas(shapely.difference(beside, shapely.union_all([world.carriageway, *_houses(world, beside)])))


def in_bays(world: World) -> list[tuple[Polygon, str]]:
    """The places that lie in a bay, each with the id of its segment."""
    bay = ParkingPosition.STREET_SIDE
    return [(place.polygon, place.segment) for place in world.parking if place.position is bay]


def on_sidewalks(world: World) -> list[Polygon]:
    """The places that lie on a sidewalk, at least with two wheels: paved at its height."""
    on_kerb = (ParkingPosition.ON_KERB, ParkingPosition.HALF_ON_KERB)
    return [place.polygon for place in world.parking if place.position in on_kerb]


def _closed(shape: BaseGeometry) -> BaseGeometry:
    return shape.buffer(GAP_M / 2, join_style="mitre").buffer(-GAP_M / 2, join_style="mitre")


def _houses(world: World, near: BaseGeometry) -> Iterable[Polygon]:
    return (building.polygon for building in world.buildings if building.polygon.intersects(near))


def _areas(shape: BaseGeometry) -> BaseGeometry:
    """Without slivers narrower than 0.2 m."""
    return shapely.intersection(shape.buffer(-0.1).buffer(0.12, join_style="mitre"), shape)


LEAST_M2: Final = 0.9  # A shorter piece of gutter is not built
TAPER_M: Final = 2.2  # Where a gutter ends it narrows over this length along the kerb
CORNER_M: Final = 40.0  # A kerb around a corner is shorter
_NEAR_M: Final = 0.5
_LAP_M: Final = 0.4


def gutters_of(road: BaseGeometry, segments: Sequence[Segment], kerbed: BaseGeometry) -> list[Polygon]:
    """The gutters of a world.

    Args:
        kerbed: where the carriageway has kerbs.
    """
    own = [segment.polygon for segment in segments if has_gutter(segment.street)]
    if not own:
        return []
    others = shapely.union_all([segment.polygon for segment in segments if not has_gutter(segment.street)])
    # A corner's kerb lies next to the end of a street without a gutter: only its continuation along the street counts.
    beside = shapely.buffer(others, -0.2)
    built = shapely.intersection(shapely.union_all(shapely.buffer(np.array(own, dtype=object), _NEAR_M)), kerbed)
    strip = shapely.difference(road, road.buffer(-GUTTER_M, quad_segs=3))
    along = [part for part in _polygons(shapely.intersection(strip, built)) if part.area > LEAST_M2]
    with_gutter = shapely.union_all(along).buffer(0.02)
    added: list[BaseGeometry] = []
    for free in _lines(shapely.difference(road.boundary, with_gutter)):
        ends = [with_gutter.distance(shapely.Point(free.coords[end])) < 0.05 for end in (0, -1)]
        around = all(ends) and free.length < CORNER_M and kerbed.buffer(0.05).contains(free)
        if around and not shapely.dwithin(beside, free, GUTTER_M + 0.3):
            added.append(shapely.intersection(strip, free.buffer(GUTTER_M + 0.02)))
        else:
            added += [_taper(road, free, end) for end in (0, -1) if ends[end]]
    whole = shapely.union_all([*along, *added]).buffer(0.01).buffer(-0.01)
    return list(_polygons(shapely.difference(shapely.intersection(whole, road), others)))


def _taper(road: BaseGeometry, free: LineString, end: int) -> BaseGeometry:
    """The narrowing end of a gutter, from one end of a kerb that has none; it laps over the gutter's own end."""
    outward = free if end == 0 else LineString(free.coords[::-1])
    line = substring(outward, 0.0, min(TAPER_M, free.length / 2))
    if line.length < 0.3:
        return Polygon()
    kerb = shapely.get_coordinates(shapely.segmentize(line, 0.25))
    kerb = np.concatenate([kerb[:1] - _unit(kerb[1] - kerb[0]) * _LAP_M, kerb])
    ways = ways_along(kerb) - _LAP_M
    step = np.gradient(kerb, axis=0)
    left = np.column_stack([-step[:, 1], step[:, 0]]) / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    middle = len(kerb) // 2
    inward = 1.0 if road.contains(shapely.Point(kerb[middle] + 0.1 * left[middle])) else -1.0
    width = GUTTER_M * np.clip(1.0 - ways / line.length, 0.0, 1.0)
    # The kerb's side lies a little outside: what is cut off by the road's own edge leaves no sliver.
    outer, inner = kerb - inward * 0.05 * left, kerb + inward * width[:, None] * left
    return shapely.make_valid(Polygon(np.concatenate([outer, inner[::-1]])))


def _unit(step: Float64Array) -> Float64Array:
    return np.asarray(step / max(float(np.hypot(*step)), 1e-9))


def _polygons(shape: BaseGeometry) -> Iterator[Polygon]:
    return (part for part in shapely.get_parts(shape) if isinstance(part, Polygon) and part.area > 1e-3)


def _lines(shape: BaseGeometry) -> Iterator[LineString]:
    merged = shapely.line_merge(shape)
    return (part for part in shapely.get_parts(merged) if isinstance(part, LineString) and part.length > 0.3)
