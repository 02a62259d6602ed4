"""Map features of OpenStreetMap besides roads: buildings, trees, street lamps, poles, signs, green areas, and the
names of streets in Latin letters.

Coordinates are in the world frame (metres). Features further than `REACH_M` from every street are omitted.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import LineString, Point, Polygon

from pavetwin.world.georeference import GeoReference, from_wgs84
from pavetwin.world.model import FurnitureKind, Surface
from pavetwin.world.network import is_street
from pavetwin.world.osm_file import osm_objects
from pavetwin.world.parking.mapped import MappedArea, Obstacle, ParkingMap, obstacle_kind
from pavetwin.world.parking.tags import area_parking
from pavetwin.world.streets import polygons_of
from pavetwin.world.tags import building_height_m, latin_name, metres

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
    """Something upright; sizes are None when the map has none."""

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
    """By the name of a street in another script."""
    bridges: list[LineString] = field(default_factory=list)
    """Of streets."""
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
