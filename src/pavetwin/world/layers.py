"""A world's collections as layers of one GeoPackage, and back.

Layers: segments (polygons), centre_lines, lanes, sidewalks, junctions, crossings, buildings, furniture, parks, defects.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.world.content import round_to_grid
from pavetwin.world.model import (
    Building,
    Crossing,
    Defect,
    DefectClass,
    Furniture,
    FurnitureKind,
    GeoReference,
    Junction,
    Lane,
    LaneKind,
    Segment,
    Severity,
    World,
)

STAMP = "2000-01-01T00:00:00.000Z"
"""Written instead of the time, so that the same world gives the same bytes."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Layer:
    """How one layer is made from a world. `rows` yields each row's columns with its geometry under `geometry`."""

    name: str
    geometry: str
    columns: Mapping[str, type]
    rows: Callable[[World], Iterator[Row]]


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
                "kind": item.kind.value,
                "width_m": item.width_m,
                "speed_limit_mps": item.speed_limit_mps,
                "geometry": item.centre_line,
            }


def _junctions(world: World) -> Iterator[Row]:
    return ({"id": item.id, "kind": item.kind, "geometry": item.polygon} for item in world.junctions)


def _crossings(world: World) -> Iterator[Row]:
    return ({"id": item.id, "signalled": item.signalled, "geometry": item.polygon} for item in world.crossings)


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
            "kind": item.kind.value,
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


_LANE_COLUMNS = {"id": str, "edge": str, "kind": str, "width_m": float, "speed_limit_mps": float}

LAYERS = (
    Layer(
        "segments",
        "MultiPolygon",
        {"id": str, "street": str, "edges": str, "width_m": float, "lanes": int, "length_m": float, "area_m2": float},
        _segments,
    ),
    Layer("centre_lines", "LineString", {"id": str, "street": str}, _centre_lines),
    Layer("lanes", "LineString", _LANE_COLUMNS, lambda world: _lanes(world, sidewalks=False)),
    Layer("sidewalks", "LineString", _LANE_COLUMNS, lambda world: _lanes(world, sidewalks=True)),
    Layer("junctions", "MultiPolygon", {"id": str, "kind": str}, _junctions),
    Layer("crossings", "Polygon", {"id": str, "signalled": bool}, _crossings),
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

_DTYPES: dict[type, Any] = {str: object, float: np.float64, int: np.int64, bool: np.bool_}


def write_layers(world: World, path: Path) -> None:
    """Write all layers to a new GeoPackage.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    import pyogrio

    with _gdal_options():
        for layer in LAYERS:
            rows = list(layer.rows(world))
            geometries = np.array([_projected(row["geometry"], world.georeference) for row in rows], dtype=object)
            data = [np.array([row[name] for row in rows], dtype=_DTYPES[kind]) for name, kind in layer.columns.items()]
            try:
                pyogrio.raw.write(
                    path,
                    geometry=shapely.to_wkb(geometries),
                    field_data=data,
                    fields=np.array(list(layer.columns), dtype=object),
                    layer=layer.name,
                    driver="GPKG",
                    geometry_type=layer.geometry,
                    promote_to_multi=layer.geometry.startswith("Multi"),
                    crs=f"EPSG:{world.georeference.epsg}",
                )
            except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError) as error:
                raise OSError(f"{path.name} could not be written ({error})") from error


@contextmanager
def _gdal_options() -> Iterator[None]:
    """A fixed date, for GDAL writes today's otherwise; and no waiting for the disk."""
    import pyogrio

    options = {"OGR_CURRENT_DATE": STAMP, "OGR_SQLITE_SYNCHRONOUS": "OFF"}
    before = {name: pyogrio.get_gdal_config_option(name) for name in options}
    pyogrio.set_gdal_config_options(options)
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options(before)


def _projected(geometry: BaseGeometry, place: GeoReference) -> BaseGeometry:
    moved: BaseGeometry = shapely.transform(geometry, lambda xy: place.to_projected(xy))
    return moved


def read_layers(path: Path, place: GeoReference, mending: str) -> dict[str, Any]:
    """The collections of a world, as keyword arguments of `World`.

    Raises:
        PaveTwinError: the file is no GeoPackage, or a layer or column is missing; `mending` ends the message.
    """
    tables = {layer.name: _read(path, layer, place, mending) for layer in LAYERS}
    lines = {row["id"]: row["geometry"] for row in tables["centre_lines"]}
    try:
        return {
            "segments": tuple(_segment(row, lines) for row in tables["segments"]),
            "lanes": tuple(_lane(row) for name in ("lanes", "sidewalks") for row in tables[name]),
            "junctions": tuple(Junction(row["id"], row["kind"], row["geometry"]) for row in tables["junctions"]),
            "crossings": tuple(Crossing(row["id"], row["geometry"], row["signalled"]) for row in tables["crossings"]),
            "buildings": tuple(Building(row["id"], row["geometry"], row["height_m"]) for row in tables["buildings"]),
            "furniture": tuple(_thing(row) for row in tables["furniture"]),
            "parks": tuple(row["geometry"] for row in tables["parks"]),
            "defects": tuple(_defect(row) for row in tables["defects"]),
        }
    except (KeyError, ValueError, TypeError) as error:
        raise PaveTwinError(f"'{path}' is damaged (at {error}); {mending}") from error


def _read(path: Path, layer: Layer, place: GeoReference, mending: str) -> Sequence[Row]:
    import pyogrio

    try:
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=layer.name)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError) as error:
        raise PaveTwinError(f"'{path}' has no readable layer '{layer.name}'; {mending}") from error
    columns = dict(zip(meta["fields"], fields, strict=True))
    for name in layer.columns:
        if name not in columns:
            raise PaveTwinError(f"'{path}' has no column '{name}' in the layer '{layer.name}'; {mending}")

    def to_world(xy: Float64Array) -> Float64Array:
        return round_to_grid(xy - (place.offset_east_m, place.offset_north_m))

    shapes = shapely.transform(shapely.from_wkb(geometry), to_world)
    return [
        {
            **{name: _plain(kind, columns[name][index]) for name, kind in layer.columns.items()},
            "geometry": _single(shape),
        }
        for index, shape in enumerate(shapes)
    ]


def _plain(kind: type, value: Any) -> Any:
    """A column's value as Python has it; an empty text is NULL in some tools."""
    return "" if kind is str and value is None else kind(value)


def _single(shape: BaseGeometry) -> BaseGeometry:
    return shape.geoms[0] if isinstance(shape, MultiPolygon) and len(shape.geoms) == 1 else shape


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
    return Lane(row["id"], row["edge"], kind, row["geometry"], row["width_m"], row["speed_limit_mps"])


def _thing(row: Row) -> Furniture:
    columns = {name: value for name, value in row.items() if name not in ("geometry", "kind")}
    return Furniture(kind=FurnitureKind(row["kind"]), position=row["geometry"], **columns)


def _defect(row: Row) -> Defect:
    centre = shapely.Point(row["centre_east_m"], row["centre_north_m"])
    return Defect(
        id=row["id"],
        segment=row["segment"],
        kind=DefectClass(row["kind"]),
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
