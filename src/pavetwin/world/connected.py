"""Which of a map's streets are not in its network: netconvert keeps the largest connected part and says nothing."""

import re
from dataclasses import dataclass
from itertools import pairwise
from math import asin, cos, hypot, radians, sin, sqrt
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field

from pavetwin.config.base import Settings
from pavetwin.world.groups import groups
from pavetwin.world.osm_file import osm_objects

EARTH_RADIUS_M: Final = 6_371_009.0
"""Mean radius of the WGS 84 ellipsoid (IUGG)."""

Degrees = tuple[float, float]
"""Longitude and latitude."""


class LeftOut(Settings):
    """Streets of a map that no other street joins to the network; ways without a name count one each."""

    streets: Annotated[int, Field(ge=0)] = 0
    length_m: Annotated[float, Field(ge=0)] = 0.0


@dataclass(frozen=True, slots=True)
class _Way:
    id: int
    name: str
    nodes: tuple[int, ...]


def left_out(streets: Path, network: Path) -> LeftOut:
    """What of an OSM file of streets did not come into the network that was made from it.

    A street is in it when any way that hangs together with it is.

    Raises:
        PaveTwinError: the OSM file cannot be read.
    """
    places: dict[int, Degrees] = {}
    ways: list[_Way] = []
    for item in osm_objects(streets):
        if item.is_node():
            places[item.id] = (item.lon, item.lat)
        elif item.is_way() and len(item.nodes) > 1:
            ways.append(_Way(item.id, item.tags.get("name", ""), tuple(node.ref for node in item.nodes)))
    kept_ways = {int(name) for name in re.findall(r'<edge id="-?(\d+)', network.read_text(encoding="utf-8"))}
    group = groups(way.nodes for way in ways)
    kept = {group[way.nodes[0]] for way in ways if way.id in kept_ways}
    lost = [way for way in ways if group[way.nodes[0]] not in kept]
    length_m = sum(_length_m([places[node] for node in way.nodes if node in places]) for way in lost)
    return LeftOut(streets=len({way.name or str(way.id) for way in lost}), length_m=round(length_m, 1))


def _length_m(line: list[Degrees]) -> float:
    """Along great circles (haversine formula)."""
    total = 0.0
    for (lon_a, lat_a), (lon_b, lat_b) in pairwise(line):
        north, east = sin(radians(lat_b - lat_a) / 2), sin(radians(lon_b - lon_a) / 2)
        across = sqrt(cos(radians(lat_a)) * cos(radians(lat_b))) * east
        total += 2 * EARTH_RADIUS_M * asin(hypot(north, across))
    return total
