"""Parking in OSM's tags, hours of restrictions, and rules as files."""

import datetime as dt
import json
import math
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import osmium
import pytest
import shapely
import yaml
from shapely.geometry import shape

from pavetwin.errors import PaveTwinError
from pavetwin.world.build import build_world
from pavetwin.world.georeference import from_wgs84
from pavetwin.world.model import World
from pavetwin.world.parking.mapped import (
    FORBIDDEN,
    NO_PLACES,
    UNMAPPED,
    Provision,
    SideParking,
    area_parking,
    conditional_hours,
    is_within,
    sides_of,
)
from pavetwin.world.parking.place import ParkingOrientation, ParkingPosition, ParkingSource, StreetSide
from pavetwin.world.parking.rule import parking_rule, rule_names
from scenes import built

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
    """A copy of a map without its parking tags."""
    with osmium.SimpleWriter(str(target)) as writer:
        for item in osmium.FileProcessor(str(source)):
            tags = {tag.k: tag.v for tag in item.tags}
            is_parking = tags.get("amenity") == "parking"
            dropped = {key for key in tags if key.startswith("parking") or (is_parking and key == "amenity")}
            writer.add(item.replace(tags={key: value for key, value in tags.items() if key not in dropped}))
    return target


PLACES = Provision.PLACES
LANE, HALF, KERB, BAY = ParkingPosition
PARALLEL, DIAGONAL, PERPENDICULAR = ParkingOrientation


@pytest.mark.parametrize(
    ("tags", "left", "right"),
    [
        ({}, UNMAPPED, UNMAPPED),
        ({"parking:both": "lane"}, SideParking(PLACES), SideParking(PLACES)),
        ({"parking:left": "no", "parking:right": "half_on_kerb"}, NO_PLACES, SideParking(PLACES, HALF)),
        ({"parking:right": "separate"}, UNMAPPED, SideParking(Provision.SEPARATE)),
        ({"parking:right": "yes", "parking:right:access": "no"}, UNMAPPED, NO_PLACES),
        ({"parking:left:orientation": "diagonal"}, SideParking(PLACES, LANE, DIAGONAL), UNMAPPED),
        ({"parking:left:restriction": "no_stopping"}, NO_PLACES, UNMAPPED),
        (
            {"parking:both": "street_side", "parking:left:orientation": "perpendicular", "parking:left:capacity": "9"},
            SideParking(PLACES, BAY, PERPENDICULAR, 9),
            SideParking(PLACES, BAY),
        ),
        (
            {"parking:right": "lane", "parking:right:restriction:conditional": "no_parking @ (Tu-Fr 06:00-14:00)"},
            UNMAPPED,
            SideParking(PLACES, closed="Tu-Fr 06:00-14:00"),
        ),
        # the scheme before 2022
        ({"parking:lane:both": "parallel"}, SideParking(PLACES), SideParking(PLACES)),
        ({"parking:lane:left": "no_parking", "parking:lane:right": "fire_lane"}, NO_PLACES, NO_PLACES),
        (
            {"parking:lane:right": "diagonal", "parking:lane:right:diagonal": "on_kerb"},
            UNMAPPED,
            SideParking(PLACES, KERB, DIAGONAL),
        ),
        ({"parking:lane:left": "marked"}, SideParking(PLACES), UNMAPPED),
        ({"parking:lane:left": "parallel", "parking:condition:left": "no_stopping"}, NO_PLACES, UNMAPPED),
        (
            {
                "parking:lane:left": "parallel",
                "parking:condition:left": "no_parking",
                "parking:condition:left:time_interval": "Mo-Fr 08:00-10:00",
            },
            SideParking(PLACES, closed="Mo-Fr 08:00-10:00"),
            UNMAPPED,
        ),
        ({"parking:lane:left": "parallel", "parking:left": "no"}, NO_PLACES, UNMAPPED),
    ],
)
def test_both_schemes_are_read(tags: dict[str, str], left: SideParking, right: SideParking) -> None:
    assert sides_of(tags) == {StreetSide.LEFT: left, StreetSide.RIGHT: right}


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"parking": "street_side", "orientation": "perpendicular", "capacity": "4"}, (BAY, PERPENDICULAR, 4)),
        ({"parking": "lane"}, (LANE, PARALLEL, None)),
        ({"parking": "surface"}, None),
        ({"parking": "underground"}, None),
        ({"parking": "street_side", "restriction": "loading_only"}, None),
        ({"parking": "lane", "access": "no"}, None),
        ({"parking": "lane", "access": "no", "disabled": "designated"}, (LANE, PARALLEL, None)),
    ],
)
def test_areas_that_belong_to_a_street(tags: dict[str, str], expected: tuple[object, ...] | None) -> None:
    found = area_parking({"amenity": "parking", **tags})
    assert (found and (found.position, found.orientation, found.capacity)) == expected


@pytest.mark.parametrize(
    ("conditions", "hours"),
    [
        ("loading_only @ (Mo-Fr 07:00-17:00)", "Mo-Fr 07:00-17:00"),
        ("no_parking @ (Mo-Fr 07:00-17:00; Sa 09:00-14:00)", "Mo-Fr 07:00-17:00; Sa 09:00-14:00"),
        ("no_stopping @ 22:00-06:00", "22:00-06:00"),
        ("none @ (Mo-Fr 07:00-17:00)", ""),
        ("no_parking @ (Mo 08:00-10:00); none @ (Su)", "Mo 08:00-10:00"),
        ("no_parking @ (Mar-Oct)", ""),
        ("no_parking", ""),
    ],
)
def test_hours_of_conditional_restrictions(conditions: str, hours: str) -> None:
    assert conditional_hours(conditions, FORBIDDEN) == hours


@pytest.mark.parametrize(
    ("hours", "date", "time", "inside"),
    [
        ("Mo-Fr 07:00-17:00", "2026-11-20", "07:00", True),  # a Friday
        ("Mo-Fr 07:00-17:00", "2026-11-20", "17:00", False),
        ("Mo-Fr 07:00-17:00", "2026-11-21", "12:00", False),
        ("Sa-Mo 07:00-17:00", "2026-11-22", "12:00", True),
        ("Mo,We-Th 08:00-10:00,14:00-16:00", "2026-11-25", "15:00", True),
        ("Mo,We-Th 08:00-10:00,14:00-16:00", "2026-11-25", "12:00", False),
        ("22:00-06:00", "2026-11-20", "23:30", True),
        ("22:00-06:00", "2026-11-20", "12:00", False),
        ("24/7", "2026-11-20", "12:00", True),
        ("Su", "2026-11-22", "12:00", True),
        ("", "2026-11-20", "12:00", False),
        ("sunrise-sunset", "2026-11-20", "12:00", False),
    ],
)
def test_a_moment_lies_in_hours(hours: str, date: str, time: str, inside: bool) -> None:
    assert is_within(hours, dt.date.fromisoformat(date), dt.time.fromisoformat(time)) is inside


@pytest.mark.parametrize("name", rule_names())
def test_places_of_a_rule_fit_next_to_each_other(name: str) -> None:
    rule = parking_rule(name)
    assert rule is not None
    for size in rule.places.values():
        angle = math.radians(size.angle_deg)
        across = size.spacing_m * math.sin(angle) if size.angle_deg else math.inf
        assert size.width_m <= across + 0.02
        assert size.angle_deg or size.length_m <= size.spacing_m


def test_a_rule_of_ones_own_is_a_file(tmp_path: Path) -> None:
    own = tmp_path / "mine.yaml"
    rule = parking_rule("europe")
    assert rule is not None
    values = rule.model_dump(mode="json")
    values["places"]["parallel"]["spacing_m"] = 6.5
    own.write_text(yaml.safe_dump(values), encoding="utf-8")
    mine = parking_rule(str(own))
    assert mine is not None
    assert mine.places[PARALLEL].spacing_m == 6.5
    own.with_name("broken.yaml").write_text("places: 3", encoding="utf-8")
    with pytest.raises(PaveTwinError, match=r"broken\.yaml"):
        parking_rule(str(own.with_name("broken.yaml")))


def test_an_unknown_rule_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(PaveTwinError, match="europe"):
        parking_rule("eurpe")
    assert parking_rule("none") is None


SURVEY = "parking/neukoelln_parking_way_west.geojson"


def test_tagged_streets_have_the_places_of_the_survey(shared_file: Callable[[str], Path]) -> None:
    found = compared(built("berlin_neukoelln").world, shared_file(SURVEY))
    assert len(found) == 5
    theirs, ours = np.array(list(found.values())).T
    deviation = (ours - theirs) / theirs
    assert np.median(np.abs(deviation)) <= 0.15
    assert np.abs(deviation).max() <= 0.25
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.10)


def test_the_rule_gives_untagged_streets_fewer_places(shared_file: Callable[[str], Path], tmp_path: Path) -> None:
    """It has parallel places only; along parks and squares the survey has perpendicular ones."""
    bare = without_parking(shared_file("osm/berlin_neukoelln.osm"), tmp_path / "bare.osm")
    world = build_world(bare).world
    assert {place.source for place in world.parking} == {ParkingSource.RULE}
    theirs, ours = np.array(list(compared(world, shared_file(SURVEY)).values())).T
    # A third too few today; a better rule may come as near as it can.
    assert -0.41 <= np.median((ours - theirs) / theirs) <= 0.15
    assert 0.55 <= ours.sum() / theirs.sum() <= 1.1
