"""A survey of parking places in Berlin-Neukölln, compared with a world's, street by street."""

import json
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import osmium
import shapely
from shapely.geometry import shape

from pavetwin.world.georeference import from_wgs84
from pavetwin.world.model import World

BESIDE = 9.0
"""A row of the survey belongs to a street up to this far from its carriageway [m]."""

LEAST = 0.02
"""Share of a row's length along a street from which it counts."""


def compared(world: World, survey: Path) -> dict[str, tuple[float, int]]:
    """Places by street: the survey's and the world's.

    A row of the survey counts with the share of its length that lies along the world's streets of its name. The survey
    ends in the east: places east of its last row in a street do not count.
    """
    strips: dict[str, list[shapely.Geometry]] = defaultdict(list)
    for segment in world.segments:
        reach = segment.width_m / 2 + BESIDE
        strips[segment.street].append(segment.centre_line.buffer(reach, cap_style="flat"))
    zones = {name: shapely.union_all(parts) for name, parts in strips.items()}
    theirs: Counter[str] = Counter()
    east: dict[str, float] = {}
    for row in json.loads(survey.read_text(encoding="utf-8"))["features"]:
        name = row["properties"]["highway:name"]
        line = shapely.transform(
            shape(row["geometry"]), lambda degrees: np.array(from_wgs84(world.georeference, degrees))
        )
        along = line.intersection(zones[name]).length / line.length if name in zones else 0.0
        if along >= LEAST:
            theirs[name] += row["properties"]["capacity"] * along
            east[name] = max(east.get(name, -np.inf), line.bounds[2])
    streets = {segment.id: segment.street for segment in world.segments}
    ours = Counter(
        streets[place.segment] for place in world.parking if place.centre.x <= east.get(streets[place.segment], -np.inf)
    )
    return {name: (count, ours[name]) for name, count in sorted(theirs.items())}


def without_parking(source: Path, target: Path) -> Path:
    """A copy of a map that says nothing about parking."""
    with osmium.SimpleWriter(str(target)) as writer:
        for item in osmium.FileProcessor(str(source)):
            tags = {tag.k: tag.v for tag in item.tags}
            is_parking = tags.get("amenity") == "parking"
            dropped = {key for key in tags if key.startswith("parking") or (is_parking and key == "amenity")}
            writer.add(item.replace(tags={key: value for key, value in tags.items() if key not in dropped}))
    return target
