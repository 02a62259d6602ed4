"""What the map says that streets are paved with, where it is not asphalt: the defect classes are those of asphalt."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from pavetwin.world.model import Segment
from pavetwin.world.network import is_street
from pavetwin.world.osm_file import osm_objects

ASPHALT: Final = frozenset({"asphalt", "paved", "chipseal"})
"""Values of OSM's `surface` to which the defect classes apply; `paved` says no more than that there is a pavement."""

_WAY: Final = re.compile(r"-?(\d+)(#.*)?")
"""The id of an edge that netconvert makes of an OSM way; of ways joined into one edge it is that of the first."""


def surfaces_in(source: Path) -> dict[int, str]:
    """The value of `surface` of each street of an OSM file that has one, by the way's id.

    Raises:
        PaveTwinError: the file cannot be read to its end.
    """
    return {
        way.id: way.tags["surface"]
        for way in osm_objects(source, only_ways=True)
        if is_street(way.tags) and "surface" in way.tags
    }


def paving_m2(segments: Iterable[Segment], surfaces: Mapping[int, str]) -> dict[str, float]:
    """Area [m²] of the segments whose street is not of asphalt, by the value of `surface`, the largest first.

    Args:
        surfaces: by the id of an OSM way, as `surfaces_in` reads them.
    """
    found: dict[str, float] = {}
    for segment in segments:
        way = _WAY.fullmatch(segment.edges[0])
        surface = surfaces.get(int(way[1]), "") if way else ""
        if surface and surface not in ASPHALT:
            found[surface] = found.get(surface, 0.0) + segment.area_m2
    return {name: round(area, 1) for name, area in sorted(found.items(), key=lambda each: (-each[1], each[0]))}


def paving_words(areas_m2: Mapping[str, float]) -> str:
    """`sett 1240 m², unpaved 90 m² of the segments; damage classes are those of asphalt`; empty where there is none."""
    if not areas_m2:
        return ""
    parts = ", ".join(f"{name.replace('_', ' ')} {area:.0f} m²" for name, area in areas_m2.items())
    return f"{parts} of the segments; damage classes are those of asphalt"
