"""A world's collections as layers of one GeoPackage, and back; `layer_tables` defines their columns."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from pavetwin import geo_files
from pavetwin.arrays import AnyArray, BoolArray, Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.world.condition import condition_columns
from pavetwin.world.content import round_to_grid
from pavetwin.world.folder import GEOPACKAGE, rebuild_hint
from pavetwin.world.georeference import GeoReference
from pavetwin.world.layer_tables import LAYERS, Layer, LayerRow, collections_of, conflicts_of
from pavetwin.world.model import LaneKind, World

if TYPE_CHECKING:
    import polars as pl

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
    pyogrio = geo_files.pyogrio()

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

    values = {name: _filled(table[name]) for name in table.columns}
    return values, {name: table[name].is_null().to_numpy() for name in table.columns if table[name].dtype != pl.String}


def _filled(column: "pl.Series") -> AnyArray:
    import polars as pl

    if column.dtype == pl.String:
        return np.array(column.to_list(), dtype=object)
    return column.fill_null(False if column.dtype == pl.Boolean else 0).to_numpy()


@contextmanager
def _gdal_options() -> Iterator[None]:
    """A fixed date instead of today's, and no synchronous writes."""
    pyogrio = geo_files.pyogrio()

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
    pyogrio = geo_files.pyogrio()

    try:
        columns = pyogrio.raw.read(folder / GEOPACKAGE, layer="lanes", columns=["kind"], read_geometry=False)[3]
        return frozenset(LaneKind(kind) for kind in columns[0])
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError, ValueError) as error:
        raise PaveTwinError(f"The world '{folder}' has no readable lanes; {rebuild_hint(folder)}") from error


def _read(path: Path, layer: Layer, place: GeoReference, hint: str) -> Sequence[LayerRow]:
    pyogrio = geo_files.pyogrio()

    if layer.optional and layer.name not in _layer_names(path):
        return []
    try:
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=layer.name)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError) as error:
        raise PaveTwinError(f"'{path}' has no readable layer '{layer.name}'; {hint}") from error
    columns = dict(zip(meta["fields"], fields, strict=True))
    wanted = {name: kind for name, kind in layer.columns.items() if name in columns or name not in layer.later}
    for name in wanted:
        if name not in columns:
            raise PaveTwinError(f"'{path}' has no column '{name}' in the layer '{layer.name}'; {hint}")

    def to_world(xy: Float64Array) -> Float64Array:
        return round_to_grid(xy - (place.offset_east_m, place.offset_north_m))

    shapes = shapely.transform(shapely.from_wkb(geometry), to_world)
    plain = {name: [_plain(kind, value) for value in columns[name].tolist()] for name, kind in wanted.items()}
    plain["geometry"] = [_single(shape) for shape in shapes]
    return [dict(zip(plain, row, strict=True)) for row in zip(*plain.values(), strict=True)]


def _layer_names(path: Path) -> list[str]:
    """Empty where the file is no GeoPackage."""
    pyogrio = geo_files.pyogrio()

    try:
        return [str(name) for name, _ in pyogrio.list_layers(path)]
    except (pyogrio.errors.DataSourceError, RuntimeError):
        return []


def _plain(kind: type, value: Any) -> Any:
    """A column's value as Python has it; an empty text is NULL in some tools."""
    return "" if kind is str and value is None else kind(value)


def _single(shape: BaseGeometry) -> BaseGeometry:
    return shape.geoms[0] if isinstance(shape, MultiPolygon) and len(shape.geoms) == 1 else shape
