"""The tables of a world's GeoPackage: how each collection becomes rows of a layer, and values again.

Layers: streets (centre lines), segments (polygons), centre_lines (of segments), lanes, sidewalks, connections,
junctions, crossings, buildings, furniture, parks, parking, defects.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from itertools import filterfalse
from operator import attrgetter, itemgetter
from typing import Any, TypeVar

from shapely import Point

from pavetwin.world.model import (
    Building,
    Connection,
    Crossing,
    Defect,
    Direction,
    Furniture,
    FurnitureKind,
    Junction,
    Lane,
    LaneKind,
    Segment,
    Severity,
    SignalLink,
    Street,
    World,
)
from pavetwin.world.parking.model import ParkingOrientation, ParkingPlace, ParkingPosition, ParkingSource, StreetSide

UNSIGNALLED = -1
"""In a column `link`: no traffic light controls it."""

LayerRow = dict[str, Any]
Item = TypeVar("Item")
Reader = Callable[[Any], Any]


@dataclass(frozen=True)
class Layer:
    """One layer of the GeoPackage and the items of a world that are its rows."""

    name: str
    geometry: str
    """Geometry type, in the words of GDAL."""
    items: Callable[[World], Iterable[Any]]
    shape: Reader
    """The geometry of an item."""
    columns: Mapping[str, type]
    computed: Mapping[str, Reader] = field(default_factory=dict)
    """The columns that are not the item's attribute of the same name."""
    later: frozenset[str] = frozenset()
    """Columns that worlds of an earlier version do not have."""
    optional: bool = False
    """Worlds of an earlier version do not have the layer."""

    def rows(self, world: World) -> Iterator[LayerRow]:
        """Each row's columns, and its geometry under `geometry`."""
        readers = {name: self.computed.get(name) or attrgetter(name) for name in self.columns}
        for item in self.items(world):
            values = {name: kind(readers[name](item)) for name, kind in self.columns.items()}
            yield {**values, "geometry": self.shape(item)}


def _is_sidewalk(lane: Lane) -> bool:
    return lane.kind is LaneKind.SIDEWALK


_LINE, _AREA = attrgetter("centre_line"), attrgetter("polygon")
_EDGES: dict[str, Reader] = {"edges": lambda item: " ".join(item.edges)}
_LENGTH: dict[str, Reader] = {"length_m": lambda item: round(item.length_m, 3)}
_SIGNAL: dict[str, Reader] = {
    "controller": lambda item: item.signal.controller if item.signal else "",
    "link": lambda item: item.signal.link if item.signal else UNSIGNALLED,
}
_CENTRE: dict[str, Reader] = {"centre_east_m": attrgetter("centre.x"), "centre_north_m": attrgetter("centre.y")}
_STREET_COLUMNS = dict.fromkeys(("id", "name", "kind", "edges", "from_junction", "to_junction"), str)
_LANE_COLUMNS = {"id": str, "edge": str, "index": int, "kind": str, "width_m": float, "speed_limit_mps": float}
_SIGNAL_COLUMNS = {"controller": str, "link": int}
_FURNITURE_SIZES = dict.fromkeys(("height_m", "radius_m", "yaw_rad", "arm_m", "clear_height_m"), float)
_DEFECT_SIZES = dict.fromkeys(("width_m", "depth_m", "length_m", "area_m2", "volume_m3"), float)

LAYERS = (
    Layer(
        "streets",
        "LineString",
        attrgetter("streets"),
        _LINE,
        {**_STREET_COLUMNS, "length_m": float, "latin_name": str, "bridges": str},
        {
            **{**_EDGES, **_LENGTH, "from_junction": attrgetter("start"), "to_junction": attrgetter("end")},
            "bridges": lambda item: "; ".join(f"{first:.2f} {last:.2f}" for first, last in item.bridges),
        },
        frozenset({"latin_name", "bridges"}),
    ),
    Layer(
        "segments",
        "MultiPolygon",
        attrgetter("segments"),
        _AREA,
        {"id": str, "street": str, "edges": str, "width_m": float, "lanes": int, "length_m": float, "area_m2": float},
        {**_EDGES, **_LENGTH, "area_m2": lambda item: round(item.area_m2, 3)},
    ),
    Layer("centre_lines", "LineString", attrgetter("segments"), _LINE, {"id": str, "street": str}),
    Layer("lanes", "LineString", lambda world: filterfalse(_is_sidewalk, world.lanes), _LINE, _LANE_COLUMNS),
    Layer("sidewalks", "LineString", lambda world: filter(_is_sidewalk, world.lanes), _LINE, _LANE_COLUMNS),
    Layer(
        "connections",
        "LineString",
        attrgetter("connections"),
        _LINE,
        {"from_lane": str, "to_lane": str, "direction": str, **_SIGNAL_COLUMNS, "via": str},
        _SIGNAL,
    ),
    Layer("junctions", "MultiPolygon", attrgetter("junctions"), _AREA, {"id": str, "kind": str}),
    Layer("crossings", "Polygon", attrgetter("crossings"), _AREA, {"id": str, **_SIGNAL_COLUMNS}, _SIGNAL),
    Layer("buildings", "Polygon", attrgetter("buildings"), _AREA, {"id": str, "height_m": float}),
    Layer(
        "furniture",
        "Point",
        attrgetter("furniture"),
        attrgetter("position"),
        {"id": str, "kind": str, **_FURNITURE_SIZES, "controller": str},
    ),
    Layer(
        "parks",
        "Polygon",
        lambda world: enumerate(world.parks, start=1),
        itemgetter(1),
        {"id": str},
        {"id": lambda numbered: f"k{numbered[0]:04d}"},
    ),
    Layer(
        "parking",
        "Polygon",
        attrgetter("parking"),
        _AREA,
        {
            **dict.fromkeys(("id", "street", "segment", "side", "position", "orientation", "source", "closed"), str),
            **dict.fromkeys(("centre_east_m", "centre_north_m", "yaw_rad", "length_m", "width_m"), float),
        },
        _CENTRE,
        optional=True,
    ),
    Layer(
        "defects",
        "Polygon",
        attrgetter("defects"),
        _AREA,
        {
            **{"id": int, "segment": str, "kind": str, "centre_east_m": float, "centre_north_m": float},
            **{"seed": int, "yaw_rad": float, "severity": str, **_DEFECT_SIZES},
            **{"parameters": str, "notch": str, "beside": str},
        },
        {
            **_CENTRE,
            "area_m2": lambda item: round(item.area_m2, 6),
            "parameters": lambda item: json.dumps(dict(item.parameters)) if item.parameters else "",
            "notch": lambda item: json.dumps(item.notch) if item.notch else "",
        },
        frozenset({"parameters", "notch", "beside"}),
    ),
)


def collections_of(tables: Mapping[str, Sequence[LayerRow]]) -> dict[str, Any]:
    """The collections of a world, as keyword arguments of `World`, from the rows of each layer.

    Raises:
        KeyError, ValueError, TypeError: a row has what its column must not have.
    """
    lines = {row["id"]: row["geometry"] for row in tables["centre_lines"]}
    lanes = [*tables["lanes"], *tables["sidewalks"]]
    return {
        "streets": tuple(
            _item(
                *(Street, row, "centre_line"),
                **{"edges": _edges(row), "start": row["from_junction"], "end": row["to_junction"]},
                bridges=_stations(row.get("bridges") or ""),
            )
            for row in tables["streets"]
        ),
        "segments": tuple(
            _item(Segment, row, "polygon", edges=_edges(row), centre_line=lines[row["id"]])
            for row in tables["segments"]
        ),
        "lanes": tuple(_item(Lane, row, "centre_line", kind=LaneKind(row["kind"])) for row in lanes),
        "connections": tuple(
            _item(Connection, row, "centre_line", direction=Direction(row["direction"]), signal=_signal(row))
            for row in tables["connections"]
        ),
        "junctions": tuple(_item(Junction, row, "polygon") for row in tables["junctions"]),
        "crossings": tuple(_item(Crossing, row, "polygon", signal=_signal(row)) for row in tables["crossings"]),
        "buildings": tuple(_item(Building, row, "polygon") for row in tables["buildings"]),
        "furniture": tuple(
            _item(Furniture, row, "position", kind=FurnitureKind(row["kind"])) for row in tables["furniture"]
        ),
        "parks": tuple(row["geometry"] for row in tables["parks"]),
        "parking": tuple(_parking_place(row) for row in tables["parking"]),
        "defects": tuple(_defect(row) for row in tables["defects"]),
    }


def _item(cls: type[Item], row: LayerRow, shape: str, **other: Any) -> Item:
    """An item from the columns that it has attributes for, its geometry, and what takes more than one column."""
    kind: Any = cls
    values = {name: row[name] for name in _field_names(kind) if name in row}
    return cls(**{**values, shape: row["geometry"], **other})


@cache
def _field_names(cls: type) -> tuple[str, ...]:
    return tuple(each.name for each in fields(cls))


def _edges(row: LayerRow) -> tuple[str, ...]:
    return tuple(row["edges"].split(" "))


def _stations(text: str) -> tuple[tuple[float, float], ...]:
    """From `12.50 40.25; …`."""
    pairs = (part.split() for part in text.split(";") if part.strip())
    return tuple((float(first), float(last)) for first, last in pairs)


def _signal(row: LayerRow) -> SignalLink | None:
    return SignalLink(row["controller"], row["link"]) if row["controller"] else None


def _defect(row: LayerRow) -> Defect:
    centre = Point(row["centre_east_m"], row["centre_north_m"])
    parameters = tuple(json.loads(row.get("parameters") or "{}").items())
    notch = tuple((float(x), float(y)) for x, y in json.loads(row.get("notch") or "[]"))
    own = {"centre": centre, "severity": Severity(row["severity"]), "parameters": parameters, "notch": notch}
    return _item(Defect, row, "polygon", **own)


def _parking_place(row: LayerRow) -> ParkingPlace:
    return ParkingPlace(
        **{name: row[name] for name in ("id", "street", "segment", "yaw_rad", "length_m", "width_m", "closed")},
        side=StreetSide(row["side"]),
        position=ParkingPosition(row["position"]),
        orientation=ParkingOrientation(row["orientation"]),
        source=ParkingSource(row["source"]),
        centre=Point(row["centre_east_m"], row["centre_north_m"]),
    )


def conflicts_of(world: Mapping[str, Any]) -> Iterator[str]:
    """Where one layer contradicts another, each as a clause."""
    lanes: dict[str, Lane] = {}
    places: dict[tuple[str, int], str] = {}
    for lane in world["lanes"]:
        if lane.id in lanes:
            yield f"two lanes have the id '{lane.id}'"
        other = places.setdefault((lane.edge, lane.index), lane.id)
        if other != lane.id:
            yield f"the lanes '{other}' and '{lane.id}' of the edge '{lane.edge}' have one index, {lane.index}"
        lanes[lane.id] = lane
    for connection in world["connections"]:
        for name in (connection.from_lane, connection.to_lane):
            if name not in lanes:
                yield (
                    f"the connection from '{connection.from_lane}' to '{connection.to_lane}' names the lane '{name}', "
                    "which is in no layer"
                )
    streets = {street.edges for street in world["streets"]}
    for segment in world["segments"]:
        if segment.edges not in streets:
            yield f"the segment '{segment.id}' lies on the edges '{' '.join(segment.edges)}', which belong to no street"
