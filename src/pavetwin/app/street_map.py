"""A world as the page's map draws it: outlines in centimetres of the world frame, and what is asked of a segment."""

import gzip
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon

from pavetwin.config.mission import UavSettings
from pavetwin.draw.extent import credit, lane_lines, sidewalks, world_bounds
from pavetwin.navigation.take_off import with_roadside_base
from pavetwin.world.model import FurnitureKind, World

_COLOURS: Final = Path(__file__).with_name("colours.json")
"""Written by `pavetwin.app.colours`; reading it takes none of the seconds that matplotlib takes to load."""

_TOLERANCE_M: Final = 0.05
"""Tolerance of simplified outlines."""


def packed_map(world: World) -> bytes:
    """The map of a world with its colours, as gzipped JSON."""
    values = street_map(world, UavSettings().radius_m)
    content = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return gzip.compress(content, 6, mtime=0)


def street_map(world: World, radius_m: float) -> dict[str, Any]:
    """All that the map shows of a world, in plain values.

    Args:
        radius_m: of the UAV, which takes off next to the carriageway.
    """
    base = with_roadside_base(world, radius_m).base
    return {
        "name": world.name,
        "colours": json.loads(_COLOURS.read_text(encoding="utf-8")),
        "content": world.content_hash,
        "bounds_m": [round(each, 2) for each in world_bounds(world)],
        "credit": credit(world) or "",
        "base_m": [round(base.x, 2), round(base.y, 2)],
        "parks": _polygons(world.parks),
        "sidewalks": _polygons([sidewalks(world)]),
        "carriageway": _polygons([world.carriageway]),
        "crossings": _polygons(crossing.polygon for crossing in world.crossings),
        "lane_lines": [_flat(line) for line in lane_lines(world)],
        "buildings": _polygons(building.polygon for building in world.buildings),
        "heights_m": [round(building.height_m, 1) for building in world.buildings],
        "trees": [
            [*_flat([(item.position.x, item.position.y)]), round(100 * item.radius_m)]
            for item in world.furniture
            if item.kind is FurnitureKind.TREE
        ],
        "segments": [
            {
                "id": segment.id,
                "street": segment.street_name,
                "latin": world.latin_name_of(segment) if segment.has_street_name else segment.street_name,
                "length_m": round(segment.length_m, 1),
                "width_m": round(segment.width_m, 1),
                "area_m2": round(segment.area_m2),
                "lanes": segment.lanes,
                "named": segment.has_street_name,
                "line": _flat(shapely.get_coordinates(segment.centre_line)),
                "surface": _polygon(segment.polygon),
            }
            for segment in world.segments
        ],
    }


def _polygons(surfaces: Iterable[Geometry]) -> list[list[list[int]]]:
    return [_polygon(part) for surface in surfaces for part in shapely.get_parts(surface) if isinstance(part, Polygon)]


def _polygon(surface: Geometry) -> list[list[int]]:
    """The rings of a surface, one after the other; filled by the rule of even and odd."""
    rings = []
    for part in shapely.get_parts(shapely.simplify(surface, _TOLERANCE_M)):
        if isinstance(part, Polygon) and not part.is_empty:
            rings += [_flat(shapely.get_coordinates(LineString(ring))) for ring in (part.exterior, *part.interiors)]
    return rings


def _flat(points: Any) -> list[int]:
    """x, y, x, y … in centimetres."""
    flat: list[int] = np.rint(np.asarray(points, dtype=np.float64).reshape(-1) * 100).astype(int).tolist()
    return flat
