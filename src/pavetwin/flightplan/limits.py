"""Limits of height, buildings and no-fly zones, and the check of a plan against them."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from math import cos, hypot, radians
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import Transformer
from shapely import LineString, Point, STRtree

from pavetwin.arrays import BoolArray
from pavetwin.errors import PaveTwinError
from pavetwin.flightplan.flight_plan import FlightPlan, PlannedFlight, parts_of
from pavetwin.geo_files import load_pyogrio
from pavetwin.world.georeference import WGS84, GeoReference, from_wgs84
from pavetwin.world.model import World

NEAR_M: Final = 20_000.0
"""A file without a zone this close to the flights is taken to be of another place (our assumption)."""

_M_PER_DEGREE: Final = 111_200.0  # Metres per degree of latitude


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """Limits of a plan."""

    highest_m: float | None = None
    """Largest height above the take-off point."""
    from_buildings_m: float = 0.0
    """Least distance to buildings, in three dimensions."""
    no_fly: Path | None = None
    """File of polygons in a format that GDAL reads."""


def check_limits(plan: FlightPlan, world: World, limits: PlanLimits, most: Collection[int | None] = ()) -> None:
    """Check a plan, and the parts of its flights, against limits.

    Args:
        most: largest numbers of waypoints of the files to write, which cut flights into parts.

    Raises:
        PaveTwinError: the plan breaks a limit, or the file of zones cannot be read or has none near the flights; the
            message states the place.
    """
    zones = [] if limits.no_fly is None else _zones_near(plan, limits.no_fly, world.georeference)
    for number, flight in _flown(plan, most):
        _check_height(number, flight, limits.highest_m)
        legs = list(_legs(flight, world.georeference))
        columns = [(Point(xy), 0.0) for xy in from_wgs84(world.georeference, flight.lonlat[[0, -1]])]
        _check_buildings(number, [*legs, *columns], world, limits.from_buildings_m)
        for name, zone in zones:
            inside = next((leg for leg, _ in legs if leg.intersects(zone)), None)
            if inside is not None:
                where = _place(inside.intersection(zone), world.georeference)
                raise PaveTwinError(f"`no_fly` {limits.no_fly}: flight {number} enters {name} at {where}.")


def _flown(plan: FlightPlan, most: Collection[int | None]) -> Iterator[tuple[str, PlannedFlight]]:
    """Flights and parts of flights with their numbers: `2`, `2, part 1`."""
    for number, flight in enumerate(plan.flights, 1):
        yield f"{number}", flight
        for limit in sorted({each for each in most if each is not None and len(flight.waypoints) > each}):
            for part, piece in enumerate(parts_of(plan, flight, limit), 1):
                yield f"{number}, part {part},", piece


def _check_height(number: str, flight: PlannedFlight, highest_m: float | None) -> None:
    flown_m = max(each.height_m for each in flight.waypoints)
    if highest_m is not None and flown_m > highest_m:
        raise PaveTwinError(
            f"`highest` {highest_m:g}: flight {number} goes up to {flown_m:g} m above take-off; fly the mission lower."
        )


def _check_buildings(
    number: str, legs: Sequence[tuple[LineString | Point, float]], world: World, least_m: float
) -> None:
    """`legs` in the world frame, each with its lower height; climb and landing are points on the ground."""
    tree = STRtree([each.polygon for each in world.buildings])
    for leg, height_m in legs:
        for index in tree.query(leg, predicate="dwithin", distance=max(least_m, 1e-9)):
            building = world.buildings[index]
            away_m = hypot(leg.distance(building.polygon), max(0.0, height_m - building.height_m))
            if away_m < least_m or away_m == 0.0:
                where = _place(shapely.shortest_line(leg, building.polygon), world.georeference)
                climbs = isinstance(leg, Point)
                doing = "climbs or lands" if climbs else "comes"
                mend = "choose another `base`" if climbs else "fly the mission higher, or leave that street out"
                raise PaveTwinError(
                    f"`from_buildings` {least_m:g}: flight {number} {doing} as near as {away_m:.1f} m to the building "
                    f"'{building.id}' at {where}; {mend}."
                )


def _legs(flight: PlannedFlight, place: GeoReference) -> Iterator[tuple[LineString, float]]:
    """Legs in the world frame, each with its lower height."""
    xy = from_wgs84(place, flight.lonlat)
    heights = [each.height_m for each in flight.waypoints]
    for begin in range(len(xy) - 1):
        yield LineString(xy[begin : begin + 2]), min(heights[begin : begin + 2])


def _place(shape: shapely.Geometry, place: GeoReference) -> str:
    longitude, latitude = place.to_wgs84(shapely.get_coordinates(shape)[0])
    return f"{latitude:.6f},{longitude:.6f}"


def _zones_near(plan: FlightPlan, path: Path, place: GeoReference) -> list[tuple[str, shapely.Geometry]]:
    """The zones of a file near the flights, in the world frame.

    Raises:
        PaveTwinError: see `read_zones`; or no zone is within `NEAR_M` of the flights: the file is of another place, or
            swaps longitude and latitude.
    """
    lonlat = np.concatenate([flight.lonlat for flight in plan.flights])
    around = _widened(*lonlat.min(axis=0), *lonlat.max(axis=0))
    zones = read_zones(path)
    bounds = shapely.bounds(np.array([zone for _, zone in zones]))
    near = [zones[at] for at in np.flatnonzero(_overlap(bounds, around))]
    if not near:
        swapped = _overlap(bounds[:, [1, 0, 3, 2]], around).any()
        why = "longitude comes before latitude, and it has them the other way round" if swapped else ""
        raise PaveTwinError(
            f"`no_fly` {path}: no zone lies within {NEAR_M / 1000:g} km of the flights, so nothing would be "
            f"checked; {why or 'check its coordinates, or leave it out where there are no zones'}."
        )
    return [(name, shapely.transform(zone, lambda xy: from_wgs84(place, xy))) for name, zone in near]


def _widened(west: float, south: float, east: float, north: float) -> np.ndarray:
    """(4,) bounds in degrees, widened by `NEAR_M` on each side."""
    up = NEAR_M / _M_PER_DEGREE
    aside = up / max(0.01, cos(radians(max(abs(south), abs(north)))))
    return np.array([west - aside, south - up, east + aside, north + up])


def _overlap(bounds: np.ndarray, around: np.ndarray) -> BoolArray:
    """(n,) True where one of the bounds (n, 4) meets `around`."""
    return np.asarray(np.all((bounds[:, :2] <= around[2:]) & (around[:2] <= bounds[:, 2:]), axis=1))


def read_zones(path: Path) -> list[tuple[str, shapely.Geometry]]:
    """The polygons of a file in WGS 84, each with its name in messages.

    Raises:
        PaveTwinError: the file cannot be read, has no polygon, other shapes, or coordinates that are not degrees.
    """
    pyogrio = load_pyogrio()

    check_file(path)
    zones: list[tuple[str, shapely.Geometry]] = []
    try:
        for layer, _ in pyogrio.list_layers(path):
            meta, _, shapes, fields = pyogrio.raw.read(path, layer=layer)
            if shapes is None:
                continue
            names = dict(zip(meta["fields"], fields, strict=True)).get("name")
            to_wgs84 = Transformer.from_crs(meta["crs"] or WGS84, WGS84, always_xy=True)

            def to_lonlat(xy: np.ndarray, to_wgs84: Transformer = to_wgs84) -> np.ndarray:
                return np.column_stack(to_wgs84.transform(xy[:, 0], xy[:, 1]))

            for number, shape in enumerate(shapely.force_2d(shapely.from_wkb(shapes)), 1):
                feature = f"feature {number} of '{layer}'"
                if shape is None or not (polygons := _polygons(shape)):
                    is_empty = shape is None or shape.is_empty
                    holds = "has no geometry" if is_empty else f"({shape.geom_type}) is not made of polygons alone"
                    raise PaveTwinError(f"`no_fly` {path}: {feature} {holds}; draw each zone as a polygon.")
                _check_degrees(to_lonlat(shapely.get_coordinates(shape)), f"`no_fly` {path}: {feature}")
                name = None if names is None else names[number - 1]
                called = feature if name is None or name != name else f"'{name}'"  # GDAL's null is None or NaN
                zones += [(called, shapely.transform(shapely.make_valid(each), to_lonlat)) for each in polygons]
    except (
        pyogrio.errors.DataSourceError,
        pyogrio.errors.DataLayerError,
        RuntimeError,
        shapely.GEOSException,
    ) as error:
        raise PaveTwinError(f"`no_fly` {path}: not a file of polygons that GDAL reads.") from error
    if not zones:
        raise PaveTwinError(f"`no_fly` {path}: it holds no polygon.")
    return zones


def _check_degrees(lonlat: np.ndarray, what: str) -> None:
    """Raises:
    PaveTwinError: a coordinate is not on the earth.
    """
    wrong = ~(np.isfinite(lonlat).all(axis=1) & (np.abs(lonlat) <= (180.0, 90.0)).all(axis=1))
    if wrong.any():
        x, y = lonlat[wrong][0]
        raise PaveTwinError(
            f"{what} has a corner at {x:g}, {y:g}, which are not a longitude and latitude in degrees; GeoJSON is in "
            "WGS "
            "84, and another file must state its coordinate system."
        )


def check_file(path: Path) -> None:
    """Check a file of zones before it is read.

    Raises:
        PaveTwinError: it does not exist.
    """
    if path.is_dir():
        raise PaveTwinError(f"`no_fly` {path}: it is a folder; name a file of polygons in it.")
    if not path.is_file():
        raise PaveTwinError(f"`no_fly` {path}: there is no such file.")


def _polygons(shape: shapely.Geometry) -> list[shapely.Geometry]:
    """The polygons of a geometry; empty if any part of it is another shape."""
    kind = shapely.get_type_id(shape)
    if kind == shapely.GeometryType.POLYGON:
        return [] if shapely.is_empty(shape) else [shape]
    if kind not in (shapely.GeometryType.MULTIPOLYGON, shapely.GeometryType.GEOMETRYCOLLECTION):
        return []
    parts = [_polygons(each) for each in shapely.get_parts(shape)]
    return [polygon for part in parts for polygon in part] if all(parts) else []
