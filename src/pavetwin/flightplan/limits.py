"""Limits that a user states, and whether a plan keeps them."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot
from pathlib import Path

import numpy as np
import shapely
from pyproj import Transformer
from shapely import LineString, STRtree

from pavetwin.errors import PaveTwinError
from pavetwin.flightplan.model import FlightPlan, PlannedFlight
from pavetwin.world.georeference import WGS84, GeoReference, from_wgs84
from pavetwin.world.model import World


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """What a plan must keep."""

    highest_m: float | None = None
    """Above the take-off point."""
    from_buildings_m: float = 0.0
    """Least distance to the buildings of the world, in space."""
    no_fly: Path | None = None
    """Polygons, in a format that GDAL reads."""


def check_limits(plan: FlightPlan, world: World, limits: PlanLimits) -> None:
    """Raises:
    PaveTwinError: the plan breaks a limit, or the file of the zones cannot be read; the message names the place.
    """
    zones = [] if limits.no_fly is None else read_zones(limits.no_fly, world.georeference)
    for number, flight in enumerate(plan.flights, 1):
        _check_height(number, flight, limits.highest_m)
        legs = list(_legs(flight, world.georeference))
        _check_buildings(number, legs, world, limits.from_buildings_m)
        for name, zone in zones:
            inside = next((leg for leg, _ in legs if leg.intersects(zone)), None)
            if inside is not None:
                where = _place(inside.intersection(zone), world.georeference)
                raise PaveTwinError(f"`no_fly` {limits.no_fly}: flight {number} enters {name} at {where}.")


def _check_height(number: int, flight: PlannedFlight, highest_m: float | None) -> None:
    flown_m = max(each.height_m for each in flight.waypoints)
    if highest_m is not None and flown_m > highest_m:
        raise PaveTwinError(
            f"`highest` {highest_m:g}: flight {number} goes up to {flown_m:g} m above take-off; fly the mission lower."
        )


def _check_buildings(number: int, legs: list[tuple[LineString, float]], world: World, least_m: float) -> None:
    tree = STRtree([each.polygon for each in world.buildings])
    for leg, height_m in legs:
        for index in tree.query(leg, predicate="dwithin", distance=max(least_m, 1e-9)):
            building = world.buildings[index]
            away_m = hypot(leg.distance(building.polygon), max(0.0, height_m - building.height_m))
            if away_m < least_m or away_m == 0.0:
                where = _place(shapely.shortest_line(leg, building.polygon), world.georeference)
                raise PaveTwinError(
                    f"`from_buildings` {least_m:g}: flight {number} comes as near as {away_m:.1f} m to the building "
                    f"'{building.id}' at {where}; fly the mission higher, or leave that street out."
                )


def _legs(flight: PlannedFlight, place: GeoReference) -> Iterator[tuple[LineString, float]]:
    """The legs in the world frame, and the lower height of each."""
    xy = from_wgs84(place, flight.lonlat)
    heights = [each.height_m for each in flight.waypoints]
    for begin in range(len(xy) - 1):
        yield LineString(xy[begin : begin + 2]), min(heights[begin : begin + 2])


def _place(shape: shapely.Geometry, place: GeoReference) -> str:
    longitude, latitude = place.to_wgs84(shapely.get_coordinates(shape)[0])
    return f"{latitude:.6f},{longitude:.6f}"


def read_zones(path: Path, place: GeoReference) -> list[tuple[str, shapely.Geometry]]:
    """The polygons of a file, in the world frame, each with what messages call it.

    Raises:
        PaveTwinError: it cannot be read, or holds no polygon.
    """
    import pyogrio

    if not path.is_file():
        raise PaveTwinError(f"`no_fly` {path}: there is no such file.")
    zones: list[tuple[str, shapely.Geometry]] = []
    try:
        for layer, _ in pyogrio.list_layers(path):
            meta, _, shapes, fields = pyogrio.raw.read(path, layer=layer)
            if shapes is None:
                continue
            names = dict(zip(meta["fields"], fields, strict=True)).get("name")
            to_wgs84 = Transformer.from_crs(meta["crs"] or WGS84, WGS84, always_xy=True)

            def to_world(xy: np.ndarray, to_wgs84: Transformer = to_wgs84) -> np.ndarray:
                return from_wgs84(place, np.column_stack(to_wgs84.transform(xy[:, 0], xy[:, 1])))

            for number, shape in enumerate(shapely.force_2d(shapely.from_wkb(shapes)), 1):
                if shape is not None and shape.geom_type in ("Polygon", "MultiPolygon"):
                    name = f"'{names[number - 1]}'" if names is not None else f"polygon {number} of '{layer}'"
                    zones.append((name, shapely.transform(shapely.make_valid(shape), to_world)))
    except (
        pyogrio.errors.DataSourceError,
        pyogrio.errors.DataLayerError,
        RuntimeError,
        shapely.GEOSException,
    ) as error:
        raise PaveTwinError(f"`no_fly` {path}: not a file of polygons that GDAL reads ({error}).") from error
    if not zones:
        raise PaveTwinError(f"`no_fly` {path}: it holds no polygon.")
    return zones
