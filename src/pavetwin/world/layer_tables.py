"""The tables of a world's GeoPackage: how each collection becomes rows of a layer, and values again.

Layers: streets (centre lines), segments (polygons), centre_lines (of segments), lanes, sidewalks, connections,
junctions, crossings, buildings, furniture, parks, defects.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import shapely

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

UNSIGNALLED = -1
"""In a column `link`: no traffic light controls it."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Layer:
    """How one layer is made from a world. `rows` yields each row's columns with its geometry under `geometry`."""

    name: str
    geometry: str
    columns: Mapping[str, type]
    rows: Callable[[World], Iterator[Row]]


def _streets(world: World) -> Iterator[Row]:
    for item in world.streets:
        yield {
            "id": item.id,
            "name": item.name,
            "kind": item.kind,
            "edges": " ".join(item.edges),
            "from_junction": item.start,
            "to_junction": item.end,
            "length_m": round(item.length_m, 3),
            "geometry": item.centre_line,
        }


def _segments(world: World) -> Iterator[Row]:
    for item in world.segments:
        yield {
            "id": item.id,
            "street": item.street,
            "edges": " ".join(item.edges),
            "width_m": item.width_m,
            "lanes": item.lanes,
            "length_m": round(item.length_m, 3),
            "area_m2": round(item.area_m2, 3),
            "geometry": item.polygon,
        }


def _centre_lines(world: World) -> Iterator[Row]:
    return ({"id": item.id, "street": item.street, "geometry": item.centre_line} for item in world.segments)


def _lanes(world: World, *, sidewalks: bool) -> Iterator[Row]:
    for item in world.lanes:
        if (item.kind is LaneKind.SIDEWALK) == sidewalks:
            yield {
                "id": item.id,
                "edge": item.edge,
                "index": item.index,
                "kind": item.kind.value,
                "width_m": item.width_m,
                "speed_limit_mps": item.speed_limit_mps,
                "geometry": item.centre_line,
            }


def _connections(world: World) -> Iterator[Row]:
    for item in world.connections:
        yield {
            "from_lane": item.from_lane,
            "to_lane": item.to_lane,
            "direction": item.direction.value,
            **_signal_columns(item.signal),
            "via": item.via,
            "geometry": item.centre_line,
        }


def _signal_columns(signal: SignalLink | None) -> Row:
    controller, link = signal or ("", UNSIGNALLED)
    return {"controller": controller, "link": link}


def _junctions(world: World) -> Iterator[Row]:
    return ({"id": item.id, "kind": item.kind, "geometry": item.polygon} for item in world.junctions)


def _crossings(world: World) -> Iterator[Row]:
    return ({"id": item.id, **_signal_columns(item.signal), "geometry": item.polygon} for item in world.crossings)


def _buildings(world: World) -> Iterator[Row]:
    return ({"id": item.id, "height_m": item.height_m, "geometry": item.polygon} for item in world.buildings)


def _furniture(world: World) -> Iterator[Row]:
    for item in world.furniture:
        yield {
            "id": item.id,
            "kind": item.kind.value,
            "height_m": item.height_m,
            "radius_m": item.radius_m,
            "yaw_rad": item.yaw_rad,
            "arm_m": item.arm_m,
            "clear_height_m": item.clear_height_m,
            "controller": item.controller,
            "geometry": item.position,
        }


def _parks(world: World) -> Iterator[Row]:
    return ({"id": f"k{number:04d}", "geometry": park} for number, park in enumerate(world.parks, start=1))


def _defects(world: World) -> Iterator[Row]:
    for item in world.defects:
        yield {
            "id": item.id,
            "segment": item.segment,
            "kind": item.kind,
            "centre_east_m": item.centre.x,
            "centre_north_m": item.centre.y,
            "seed": item.seed,
            "yaw_rad": item.yaw_rad,
            "severity": item.severity.value,
            "width_m": item.width_m,
            "depth_m": item.depth_m,
            "length_m": item.length_m,
            "area_m2": round(item.area_m2, 6),
            "volume_m3": item.volume_m3,
            "geometry": item.polygon,
        }


_LANE_COLUMNS = {"id": str, "edge": str, "index": int, "kind": str, "width_m": float, "speed_limit_mps": float}
_SIGNAL_COLUMNS = {"controller": str, "link": int}

LAYERS = (
    Layer(
        "streets",
        "LineString",
        {
            "id": str,
            "name": str,
            "kind": str,
            "edges": str,
            "from_junction": str,
            "to_junction": str,
            "length_m": float,
        },
        _streets,
    ),
    Layer(
        "segments",
        "MultiPolygon",
        {"id": str, "street": str, "edges": str, "width_m": float, "lanes": int, "length_m": float, "area_m2": float},
        _segments,
    ),
    Layer("centre_lines", "LineString", {"id": str, "street": str}, _centre_lines),
    Layer("lanes", "LineString", _LANE_COLUMNS, lambda world: _lanes(world, sidewalks=False)),
    Layer("sidewalks", "LineString", _LANE_COLUMNS, lambda world: _lanes(world, sidewalks=True)),
    Layer(
        "connections",
        "LineString",
        {"from_lane": str, "to_lane": str, "direction": str, **_SIGNAL_COLUMNS, "via": str},
        _connections,
    ),
    Layer("junctions", "MultiPolygon", {"id": str, "kind": str}, _junctions),
    Layer("crossings", "Polygon", {"id": str, **_SIGNAL_COLUMNS}, _crossings),
    Layer("buildings", "Polygon", {"id": str, "height_m": float}, _buildings),
    Layer(
        "furniture",
        "Point",
        {
            "id": str,
            "kind": str,
            "height_m": float,
            "radius_m": float,
            "yaw_rad": float,
            "arm_m": float,
            "clear_height_m": float,
            "controller": str,
        },
        _furniture,
    ),
    Layer("parks", "Polygon", {"id": str}, _parks),
    Layer(
        "defects",
        "Polygon",
        {
            "id": int,
            "segment": str,
            "kind": str,
            "centre_east_m": float,
            "centre_north_m": float,
            "seed": int,
            "yaw_rad": float,
            "severity": str,
            "width_m": float,
            "depth_m": float,
            "length_m": float,
            "area_m2": float,
            "volume_m3": float,
        },
        _defects,
    ),
)


def collections_of(tables: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """The collections of a world, as keyword arguments of `World`, from the rows of each layer.

    Raises:
        KeyError, ValueError, TypeError: a row has what its column must not have.
    """
    lines = {row["id"]: row["geometry"] for row in tables["centre_lines"]}
    return {
        "streets": tuple(_street(row) for row in tables["streets"]),
        "segments": tuple(_segment(row, lines) for row in tables["segments"]),
        "lanes": tuple(_lane(row) for name in ("lanes", "sidewalks") for row in tables[name]),
        "connections": tuple(_connection(row) for row in tables["connections"]),
        "junctions": tuple(Junction(row["id"], row["kind"], row["geometry"]) for row in tables["junctions"]),
        "crossings": tuple(Crossing(row["id"], row["geometry"], _signal(row)) for row in tables["crossings"]),
        "buildings": tuple(Building(row["id"], row["geometry"], row["height_m"]) for row in tables["buildings"]),
        "furniture": tuple(_thing(row) for row in tables["furniture"]),
        "parks": tuple(row["geometry"] for row in tables["parks"]),
        "defects": tuple(_defect(row) for row in tables["defects"]),
    }


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
            yield f"the segment '{segment.id}' lies on the edges '{' '.join(segment.edges)}', which are no street's"


def _street(row: Row) -> Street:
    return Street(
        id=row["id"],
        name=row["name"],
        kind=row["kind"],
        edges=tuple(row["edges"].split(" ")),
        start=row["from_junction"],
        end=row["to_junction"],
        centre_line=row["geometry"],
    )


def _connection(row: Row) -> Connection:
    return Connection(
        from_lane=row["from_lane"],
        to_lane=row["to_lane"],
        direction=Direction(row["direction"]),
        signal=_signal(row),
        via=row["via"],
        centre_line=row["geometry"],
    )


def _signal(row: Row) -> SignalLink | None:
    return SignalLink(row["controller"], row["link"]) if row["controller"] else None


def _segment(row: Row, lines: Mapping[str, Any]) -> Segment:
    return Segment(
        id=row["id"],
        street=row["street"],
        edges=tuple(row["edges"].split(" ")),
        centre_line=lines[row["id"]],
        polygon=row["geometry"],
        width_m=row["width_m"],
        lanes=row["lanes"],
    )


def _lane(row: Row) -> Lane:
    kind = LaneKind(row["kind"])
    return Lane(row["id"], row["edge"], row["index"], kind, row["geometry"], row["width_m"], row["speed_limit_mps"])


def _thing(row: Row) -> Furniture:
    columns = {name: value for name, value in row.items() if name not in ("geometry", "kind")}
    return Furniture(kind=FurnitureKind(row["kind"]), position=row["geometry"], **columns)


def _defect(row: Row) -> Defect:
    centre = shapely.Point(row["centre_east_m"], row["centre_north_m"])
    return Defect(
        id=row["id"],
        segment=row["segment"],
        kind=row["kind"],
        centre=centre,
        polygon=row["geometry"],
        seed=row["seed"],
        yaw_rad=row["yaw_rad"],
        severity=Severity(row["severity"]),
        width_m=row["width_m"],
        depth_m=row["depth_m"],
        length_m=row["length_m"],
        volume_m3=row["volume_m3"],
    )
