"""A world's collections as layers of one GeoPackage, and back; and styles of layers for QGIS (QML).

Layers: streets (centre lines), segments (polygons), centre_lines (of segments), lanes, sidewalks, connections,
junctions, crossings, buildings, furniture, parks, parking, defects.
"""

import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cache
from itertools import filterfalse
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import shapely
from shapely import MultiPolygon, Point
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import AnyArray, BoolArray, Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.geo_files import load_pyogrio
from pavetwin.world.condition import condition_columns
from pavetwin.world.content import round_to_grid
from pavetwin.world.folder import GEOPACKAGE, rebuild_hint
from pavetwin.world.georeference import GeoReference
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
from pavetwin.world.parking.place import ParkingOrientation, ParkingPlace, ParkingPosition, ParkingSource, StreetSide

if TYPE_CHECKING:
    import polars as pl


UNSIGNALLED = -1
"""Value of the column `link` without a traffic light."""

LayerRow = dict[str, Any]
Item = TypeVar("Item")
Reader = Callable[[Any], Any]


@dataclass(frozen=True)
class Layer:
    """Layer of the GeoPackage, and the items of a world that are its rows."""

    name: str
    geometry: str
    """Geometry type, in the words of GDAL."""
    items: Callable[[World], Iterable[Any]]
    shape: Reader
    """The geometry of an item."""
    columns: Mapping[str, type]
    computed: Mapping[str, Reader] = field(default_factory=dict)
    """The columns that are not the item's attribute of the same name."""

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
                bridges=_stations(row["bridges"]),
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
    """Parse `12.50 40.25; …`."""
    pairs = (part.split() for part in text.split(";") if part.strip())
    return tuple((float(first), float(last)) for first, last in pairs)


def _signal(row: LayerRow) -> SignalLink | None:
    return SignalLink(row["controller"], row["link"]) if row["controller"] else None


def _defect(row: LayerRow) -> Defect:
    centre = Point(row["centre_east_m"], row["centre_north_m"])
    parameters = tuple(json.loads(row["parameters"] or "{}").items())
    notch = tuple((float(x), float(y)) for x, y in json.loads(row["notch"] or "[]"))
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
    """Contradictions between layers, each as a clause."""
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


CONDITION = "condition"
"""The layer of what is damaged on each segment, for GIS programs; it follows from the defects and is not read."""

STAMP = "2000-01-01T00:00:00.000Z"
"""Written instead of the time, so that the same world gives the same bytes."""

_DTYPES: dict[type, Any] = {str: object, float: np.float64, int: np.int64}


def write_layers(world: World, path: Path) -> None:
    """Write all layers to a new GeoPackage.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    for layer in LAYERS:
        rows = list(layer.rows(world))
        data = {
            name: np.array([row[name] for row in rows], dtype=_DTYPES[kind]) for name, kind in layer.columns.items()
        }
        write_layer(path, layer.name, layer.geometry, [row["geometry"] for row in rows], data, world.georeference)
    polygons = [segment.polygon for segment in world.segments]
    write_layer(path, CONDITION, "MultiPolygon", polygons, condition_columns(world), world.georeference)


def write_layer(
    path: Path,
    name: str,
    kind: str,
    shapes: Sequence[BaseGeometry],
    columns: Mapping[str, AnyArray],
    place: GeoReference,
    masks: Mapping[str, BoolArray] | None = None,
) -> None:
    """Write one layer of a GeoPackage: shapes in the world frame, of a geometry type in the words of GDAL.

    Args:
        masks: true where a column has no value; for columns that have one in each row, none is needed.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    pyogrio = load_pyogrio()

    projected = np.array([shapely.transform(shape, place.to_projected) for shape in shapes], dtype=object)
    try:
        with _gdal_options():
            pyogrio.raw.write(
                path,
                geometry=shapely.to_wkb(projected),
                field_data=list(columns.values()),
                fields=np.array(list(columns), dtype=object),
                field_mask=[(masks or {}).get(name) for name in columns],
                layer=name,
                driver="GPKG",
                geometry_type=kind,
                promote_to_multi=kind.startswith("Multi"),
                crs=f"EPSG:{place.epsg}",
            )
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError) as error:
        raise OSError(f"{path.name} could not be written ({error})") from error


def columns_of(table: "pl.DataFrame") -> tuple[dict[str, AnyArray], dict[str, BoolArray]]:
    """The columns of a table for GDAL, texts as objects and any number where there is none; and of columns that are no
    texts, where there is none."""
    import polars as pl

    values: dict[str, AnyArray] = {}
    masks: dict[str, BoolArray] = {}
    for column in table:
        if column.dtype == pl.String:
            values[column.name] = np.array(column.to_list(), dtype=object)
        else:
            values[column.name] = column.fill_null(False if column.dtype == pl.Boolean else 0).to_numpy()
            masks[column.name] = column.is_null().to_numpy()
    return values, masks


@contextmanager
def _gdal_options() -> Iterator[None]:
    """A fixed date instead of today's, and no synchronous writes."""
    pyogrio = load_pyogrio()

    options = {"OGR_CURRENT_DATE": STAMP, "OGR_SQLITE_SYNCHRONOUS": "OFF"}
    before = {name: pyogrio.get_gdal_config_option(name) for name in options}
    pyogrio.set_gdal_config_options(options)
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options(before)


def read_layers(path: Path, place: GeoReference, hint: str) -> dict[str, Any]:
    """The collections of a world, as keyword arguments of `World`.

    Raises:
        PaveTwinError: the file is not a GeoPackage, a layer or column is missing, or a layer contradicts another one;
            `hint` ends the message.
    """
    tables = {layer.name: _read(path, layer, place, hint) for layer in LAYERS}
    try:
        world = collections_of(tables)
    except (KeyError, ValueError, TypeError) as error:
        raise PaveTwinError(f"'{path}' is damaged (at {error}); {hint}") from error
    if conflict := next(conflicts_of(world), None):
        raise PaveTwinError(f"'{path}' contradicts itself: {conflict}; {hint}")
    return world


def lane_kinds(folder: Path) -> frozenset[LaneKind]:
    """The kinds of lanes of a world that is in a folder; nothing else of it is read.

    Raises:
        PaveTwinError: it cannot be read.
    """
    pyogrio = load_pyogrio()

    try:
        columns = pyogrio.raw.read(folder / GEOPACKAGE, layer="lanes", columns=["kind"], read_geometry=False)[3]
        return frozenset(LaneKind(kind) for kind in columns[0])
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError, ValueError) as error:
        raise PaveTwinError(f"The world '{folder}' has no readable lanes; {rebuild_hint(folder)}") from error


def _read(path: Path, layer: Layer, place: GeoReference, hint: str) -> Sequence[LayerRow]:
    pyogrio = load_pyogrio()

    try:
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=layer.name)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError) as error:
        raise PaveTwinError(f"'{path}' has no readable layer '{layer.name}'; {hint}") from error
    columns = dict(zip(meta["fields"], fields, strict=True))
    for name in layer.columns:
        if name not in columns:
            raise PaveTwinError(f"'{path}' has no column '{name}' in the layer '{layer.name}'; {hint}")

    def to_world(xy: Float64Array) -> Float64Array:
        return round_to_grid(xy - (place.offset_east_m, place.offset_north_m))

    shapes = shapely.transform(shapely.from_wkb(geometry), to_world)
    plain = {name: [_plain(kind, value) for value in columns[name].tolist()] for name, kind in layer.columns.items()}
    plain["geometry"] = [_single(shape) for shape in shapes]
    return [dict(zip(plain, row, strict=True)) for row in zip(*plain.values(), strict=True)]


def _plain(kind: type, value: Any) -> Any:
    """A column's value as Python has it; an empty text is NULL in some tools."""
    return "" if kind is str and value is None else kind(value)


def _single(shape: BaseGeometry) -> BaseGeometry:
    return shape.geoms[0] if isinstance(shape, MultiPolygon) and len(shape.geoms) == 1 else shape


_DOCTYPE: Final = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


class Symbol(Enum):
    """Symbol of a feature: QGIS's type and class of symbol, and the property that holds its colour."""

    DOT = ("marker", "SimpleMarker", "color")
    AREA = ("fill", "SimpleFill", "color")
    OUTLINE = ("fill", "SimpleFill", "outline_color")


_USUAL: Final[Mapping[Symbol, Mapping[str, str]]] = {
    Symbol.DOT: {"name": "circle", "size": "3", "outline_color": "20,20,20,255", "outline_width": "0.2"},
    Symbol.AREA: {"style": "solid", "outline_color": "60,60,60,255", "outline_width": "0.2"},
    Symbol.OUTLINE: {"style": "no", "outline_width": "0.5"},
}


@dataclass(frozen=True)
class LayerStyle:
    """A layer whose features are coloured by the value of one column."""

    column: str
    colours: Mapping[str, str]
    """Colours by value: `#RRGGBB`."""
    symbol: Symbol
    opacity: float = 1.0
    """Opacity of the symbols, 0 … 1."""

    @property
    def qml(self) -> str:
        """The style as QGIS reads it."""
        kind, symbol_class, coloured = self.symbol.value
        root = Element("qgis", {"version": "3.22", "styleCategories": "Symbology|Labeling"})
        renderer = SubElement(
            root, "renderer-v2", {"type": "categorizedSymbol", "attr": self.column, "symbollevels": "0"}
        )
        listed, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
        for number, (value, colour) in enumerate(self.colours.items()):
            category = {"value": value, "label": value, "symbol": str(number), "render": "true"}
            SubElement(listed, "category", category)
            symbol = SubElement(symbols, "symbol", {"type": kind, "name": str(number), "alpha": f"{self.opacity:g}"})
            drawn = SubElement(symbol, "layer", {"class": symbol_class, "enabled": "1", "pass": "0", "locked": "0"})
            options = SubElement(drawn, "Option", {"type": "Map"})
            for key, setting in {**_USUAL[self.symbol], coloured: _rgba(colour)}.items():
                SubElement(options, "Option", {"name": key, "type": "QString", "value": setting})
                SubElement(drawn, "prop", {"k": key, "v": setting})
        return _DOCTYPE + tostring(root, encoding="unicode")


def _rgba(colour: str) -> str:
    return ",".join(str(int(colour[at : at + 2], 16)) for at in (1, 3, 5)) + ",255"


def write_styles(path: Path, styles: Mapping[str, LayerStyle]) -> None:
    """Add the table `layer_styles` to a GeoPackage, in which QGIS looks for the style of a layer that it opens.

    Args:
        styles: by layer; each of them is in the file.
    """
    with closing(sqlite3.connect(path)) as base, base:
        base.execute(
            "CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT, "
            "f_table_schema TEXT, f_table_name TEXT, f_geometry_column TEXT, styleName TEXT, styleQML TEXT, "
            "styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT, ui TEXT, update_time DATETIME)"
        )
        base.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change) "
            "VALUES ('layer_styles', 'attributes', 'layer_styles', '', ?)",
            (STAMP,),
        )
        for layer, style in styles.items():
            (column,) = base.execute(
                "SELECT column_name FROM gpkg_geometry_columns WHERE table_name = ?", (layer,)
            ).fetchone()
            base.execute(
                "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
                "styleName, styleQML, styleSLD, useAsDefault, description, owner, update_time) "
                "VALUES ('', '', ?, ?, ?, ?, '', 1, '', '', ?)",
                (layer, column, layer, style.qml, STAMP),
            )
