"""The content hash of a world, and the grid of its coordinates.

Every coordinate is a multiple of 2⁻²⁰ m (about a micrometre). A GeoPackage holds projected coordinates, which are
millions of metres and lose the last bits; rounding to the grid restores them, so that a loaded world equals the built
one exactly.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import cache
from itertools import chain, islice
from typing import Any, TypeVar

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.world.model import World

STEPS_PER_METRE = 2**20
Geometry = TypeVar("Geometry", bound=BaseGeometry)

HASHED = ("streets", "segments", "lanes", "connections", "junctions", "crossings", "buildings", "furniture", "parks")
"""Fields that identify the world of a recording or a navmesh; defects are not among them."""

HASHED_IF_ANY = ("parking",)
"""Fields that enter the hash only of worlds that have any."""

COLLECTIONS = (*HASHED, *HASHED_IF_ANY, "defects")


def round_to_grid(xy: Float64Array) -> Float64Array:
    """Coordinates on the grid nearest to these [m]; no −0, which equals 0 but hashes differently."""
    return np.asarray(np.round(xy * STEPS_PER_METRE) / STEPS_PER_METRE + 0.0, dtype=np.float64)


def snapped(geometry: Geometry) -> Geometry:
    """A geometry on the grid; a polygon that rounding made invalid is repaired."""
    moved: Any = shapely.transform(geometry, round_to_grid)
    if isinstance(moved, Polygon) and not moved.is_valid:
        moved = max(shapely.get_parts(moved.buffer(0)), key=lambda part: part.area)
        moved = shapely.transform(moved, round_to_grid)
    result: Geometry = moved
    return result


def snapped_world(world: World) -> World:
    """A world on the grid; its content hash is not updated."""
    changed: dict[str, Any] = {
        name: tuple(_snapped_item(item) for item in getattr(world, name)) for name in COLLECTIONS
    }
    return replace(world, base=snapped(world.base), **changed)


def _snapped_item(item: Any) -> Any:
    if isinstance(item, BaseGeometry):
        return snapped(item)
    geometries = {
        field.name: snapped(value)
        for field in fields(item)
        if isinstance(value := getattr(item, field.name), BaseGeometry)
    }
    return replace(item, **geometries)


def content_hash(world: World, network_sha256: str) -> str:
    """SHA-256 over the georeference, the driving side, the base, the network and all static objects except defects."""
    digest = hashlib.sha256()
    place = world.georeference
    frame = [place.epsg, place.offset_east_m, place.offset_north_m, world.left_hand, network_sha256]
    digest.update(json.dumps(frame).encode())
    digest.update(shapely.to_wkb(world.base, byte_order=1))
    for name in (*HASHED, *(name for name in HASHED_IF_ANY if getattr(world, name))):
        digest.update(name.encode())
        for part in _parts(getattr(world, name)):
            digest.update(part)
    return digest.hexdigest()


def _parts(items: Sequence[Any]) -> Iterator[bytes]:
    """Values, then geometries of each item, in the order of its fields; all geometries are written at once."""
    rows = [[item] if isinstance(item, BaseGeometry) else _hashed_values(item) for item in items]
    shapes = [[value for value in row if isinstance(value, BaseGeometry)] for row in rows]
    written = iter(shapely.to_wkb(np.array([*chain.from_iterable(shapes)], dtype=object), byte_order=1).tolist())
    for item, row, its in zip(items, rows, shapes, strict=True):
        if not isinstance(item, BaseGeometry):
            values = (value for value in row if not isinstance(value, BaseGeometry))
            plain = [value + 0.0 if isinstance(value, float) else value for value in values]  # a GeoPackage has no −0
            yield json.dumps(plain, ensure_ascii=False).encode()
        yield from islice(written, len(its))


def _hashed_values(item: Any) -> list[Any]:
    kind: Any = type(item)
    return [getattr(item, name) for name in _hashed_fields(kind)]


@cache
def _hashed_fields(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind) if field.hash is not False)
