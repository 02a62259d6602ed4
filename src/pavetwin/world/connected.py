"""Streets of a map that netconvert dropped without a warning: it keeps the largest connected part."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field
from pyproj import Geod

from pavetwin.config.base import Settings
from pavetwin.world.groups import groups
from pavetwin.world.osm_file import osm_objects

SPHERE: Final = Geod(a=6_371_009.0, b=6_371_009.0)
"""With the mean radius of the WGS 84 ellipsoid (IUGG) [m]."""

Degrees = tuple[float, float]
"""Longitude and latitude."""


class LeftOut(Settings):
    """Streets of a map that are not connected to the network; ways without a name count one each."""

    streets: Annotated[int, Field(ge=0)] = 0
    length_m: Annotated[float, Field(ge=0)] = 0.0


@dataclass(frozen=True, slots=True)
class _Way:
    id: int
    name: str
    nodes: tuple[int, ...]


def left_out(streets: Path, network: Path) -> LeftOut:
    """The streets of an OSM file that are missing in the network made from it.

    A street is in the network when any way connected with it is.

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
    """Along great circles."""
    return float(SPHERE.line_length([lon for lon, _ in line], [lat for _, lat in line]))
