"""Map features of OpenStreetMap besides the road network: buildings, trees, street lamps, poles, signs, green areas,
names of streets in Latin letters, bridges, and pavements that are not asphalt.

Coordinates are in the world frame (metres). Features further than `REACH_M` from every street are omitted.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely import LineString, Point, Polygon

from pavetwin.world.georeference import GeoReference, from_wgs84
from pavetwin.world.model import FurnitureKind, Segment, Surface
from pavetwin.world.network import is_street
from pavetwin.world.osm_file import building_height_m, latin_name, metres, osm_objects
from pavetwin.world.parking.mapped import MappedArea, Obstacle, ParkingMap, area_parking, obstacle_kind
from pavetwin.world.segments import polygons_of

REACH_M = 100.0
"""Map features up to this distance from a street belong to the world [m]."""

TREE_SPACING_M = 10.0
"""Distance between the trees of a `natural=tree_row` [m]."""

KEYS = (
    *("building", "natural", "leisure", "landuse", "highway", "power", "man_made", "traffic_sign"),
    *("amenity", "emergency"),
)

GREEN = {
    "leisure": {"park", "garden", "playground", "pitch", "golf_course", "dog_park", "nature_reserve"},
    "landuse": {"grass", "forest", "cemetery", "meadow", "recreation_ground", "village_green", "flowerbed", "orchard"},
    "natural": {"wood", "scrub", "grassland", "heath"},
}
"""Tags of areas that are drawn as parks."""

NO_BUILDING = frozenset({"no", "bridge", "construction", "proposed", "demolished", "ruins"})


@dataclass(frozen=True, slots=True)
class MappedPoint:
    """Upright object; sizes are None when they are not mapped."""

    kind: FurnitureKind
    position: Point
    height_m: float | None = None
    radius_m: float | None = None


@dataclass(slots=True)
class MapFeatures:
    buildings: list[tuple[Polygon, float]] = field(default_factory=list)
    """Footprints and heights [m]."""
    points: list[MappedPoint] = field(default_factory=list)
    parks: list[Polygon] = field(default_factory=list)
    latin_names: dict[str, str] = field(default_factory=dict)
    """Latin names by the name of a street in another script."""
    bridges: list[LineString] = field(default_factory=list)
    """Bridges of streets."""
    parking: ParkingMap = field(default_factory=ParkingMap)


def read_features(source: Path, georeference: GeoReference, streets: Surface) -> MapFeatures:
    """The features of an OSM file within `REACH_M` of the streets, in the order of the file.

    Raises:
        PaveTwinError: the file cannot be read to its end.
    """
    reader = _FeatureReader(georeference, streets.buffer(REACH_M))
    for item in osm_objects(source, areas=True, keys=KEYS):
        tags = {tag.k: tag.v for tag in item.tags}
        if item.is_area():
            reader.take_area(item, tags)
        elif item.is_node():
            reader.take_node(item, tags)
        elif item.is_way() and tags.get("natural") == "tree_row":
            reader.take_tree_row(item, tags)
        elif item.is_way() and "highway" in tags:
            reader.take_way(item, tags)
    return reader.features


class _FeatureReader:
    def __init__(self, georeference: GeoReference, reach: Surface) -> None:
        self._georeference = georeference
        self._reach = reach
        shapely.prepare(reach)
        self.features = MapFeatures()

    def take_area(self, area: Any, tags: Mapping[str, str]) -> None:
        if "building" in tags:
            if tags["building"] in NO_BUILDING or tags.get("location") == "underground":
                return
            found = self._polygons(area)
            self.features.buildings += [(polygon, building_height_m(tags, polygon.area)) for polygon in found]
        elif any(tags.get(key) in values for key, values in GREEN.items()):
            self.features.parks += self._polygons(area)
        elif parking := area_parking(tags):
            name = tags.get("street:name", "")
            self.features.parking.areas += [MappedArea(shape, parking, name) for shape in self._polygons(area)]

    def _polygons(self, area: Any) -> list[Polygon]:
        found: list[Polygon] = []
        for outer in area.outer_rings():
            holes = [self._metres(ring) for ring in area.inner_rings(outer)]
            polygon = Polygon(self._metres(outer), holes)
            found += polygons_of(polygon if polygon.is_valid else polygon.buffer(0))
        return [polygon for polygon in found if polygon.area >= 1.0 and self._reach.intersects(polygon)]

    def _metres(self, nodes: Iterable[Any]) -> list[tuple[float, float]]:
        degrees = [(node.lon, node.lat) for node in nodes if node.location.valid()]
        return [(float(x), float(y)) for x, y in from_wgs84(self._georeference, np.array(degrees))] if degrees else []

    def take_way(self, way: Any, tags: Mapping[str, str]) -> None:
        if latin := latin_name(tags):
            self.features.latin_names.setdefault(tags["name"], latin)
        corners = self._metres(way.nodes)
        if len(corners) > 1 and self._reach.intersects(line := LineString(corners)):
            self.features.parking.take_way(line, tags)
            if tags.get("bridge", "no") != "no" and is_street(tags):
                self.features.bridges.append(line)

    def take_node(self, node: Any, tags: Mapping[str, str]) -> None:
        kind, obstacle = _point_kind(tags), obstacle_kind(tags)
        if (kind is None and obstacle is None) or not node.location.valid():
            return
        x, y = from_wgs84(self._georeference, (node.lon, node.lat))
        if kind is not None:
            self._add(kind, Point(x, y), tags)
        if obstacle is not None and self._reach.intersects(at := Point(x, y)):
            self.features.parking.obstacles.append(Obstacle(obstacle, at))

    def take_tree_row(self, way: Any, tags: Mapping[str, str]) -> None:
        corners = self._metres(way.nodes)
        if len(corners) < 2:
            return
        line = LineString(corners)
        count = max(1, math.floor(line.length / TREE_SPACING_M))
        for share in np.linspace(0.0, 1.0, count + 1):
            self._add(FurnitureKind.TREE, line.interpolate(float(share), normalized=True), tags)

    def _add(self, kind: FurnitureKind, position: Point, tags: Mapping[str, str]) -> None:
        if not self._reach.intersects(position):
            return
        height = metres(tags.get("height")) or metres(tags.get("est_height"))
        crown = metres(tags.get("diameter_crown")) if kind is FurnitureKind.TREE else None
        self.features.points.append(MappedPoint(kind, position, height, crown / 2 if crown else None))


def _point_kind(tags: Mapping[str, str]) -> FurnitureKind | None:
    if tags.get("natural") == "tree":
        return FurnitureKind.TREE
    if tags.get("highway") == "street_lamp":
        return FurnitureKind.STREET_LIGHT
    if tags.get("power") == "pole" or tags.get("man_made") in ("utility_pole", "flagpole"):
        return FurnitureKind.POLE
    if "traffic_sign" in tags or tags.get("highway") in ("stop", "give_way"):
        return FurnitureKind.SIGN
    return None


NEAR_M: Final = 6.0
"""A bridge is on a street whose centre line passes its middle and both ends this near: netconvert moves centre lines by
up to half a carriageway."""

SHORTEST_M: Final = 4.0


def bridges_on(centre_line: LineString, bridges: Iterable[LineString]) -> tuple[tuple[float, float], ...]:
    """Stations [m] of a street's centre line between which it lies on a bridge, rounded to centimetres, in order.

    Args:
        bridges: the map's ways that are bridges, in the frame of the centre line; ways longer than the street count as
            far as they follow it.
    """
    found = []
    for bridge in bridges:
        ends = [bridge.project(Point(centre_line.coords[end])) for end in (0, -1)]
        low, high = min(ends), max(ends)
        points = [bridge.interpolate(low + share * (high - low)) for share in (0.05, 0.5, 0.95)]
        if all(centre_line.distance(point) < NEAR_M for point in points):
            first, last = sorted(centre_line.project(bridge.interpolate(station)) for station in (low, high))
            if last - first > SHORTEST_M:
                found.append((round(first, 2), round(last, 2)))
    return tuple(sorted(found))


ASPHALT: Final = frozenset({"asphalt", "paved", "chipseal"})
"""Values of OSM's `surface` to which the defect classes apply; `paved` states only that there is a pavement."""

_WAY: Final = re.compile(r"-?(\d+)(#.*)?")
"""The id of an edge that netconvert makes of an OSM way; of ways joined into one edge it is that of the first."""


def surfaces_in(source: Path) -> dict[int, str]:
    """The value of `surface` of each street of an OSM file that has one, by the way's id.

    Raises:
        PaveTwinError: the file cannot be read to its end.
    """
    return {
        way.id: way.tags["surface"]
        for way in osm_objects(source, only_ways=True)
        if is_street(way.tags) and "surface" in way.tags
    }


def paving_m2(segments: Iterable[Segment], surfaces: Mapping[int, str]) -> dict[str, float]:
    """Area [m²] of the segments whose street is not of asphalt, by the value of `surface`, the largest first.

    Args:
        surfaces: by the id of an OSM way, as `surfaces_in` reads them.
    """
    found: dict[str, float] = {}
    for segment in segments:
        way = _WAY.fullmatch(segment.edges[0])
        surface = surfaces.get(int(way[1]), "") if way else ""
        if surface and surface not in ASPHALT:
            found[surface] = found.get(surface, 0.0) + segment.area_m2
    return {name: round(area, 1) for name, area in sorted(found.items(), key=lambda each: (-each[1], each[0]))}


def paving_words(areas_m2: Mapping[str, float]) -> str:
    """`sett 1240 m², unpaved 90 m² of the segments; damage classes are those of asphalt`; empty where there is none."""
    if not areas_m2:
        return ""
    parts = ", ".join(f"{name.replace('_', ' ')} {area:.0f} m²" for name, area in areas_m2.items())
    return f"{parts} of the segments; damage classes are those of asphalt"
