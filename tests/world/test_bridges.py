"""Bridges of the map: on which part of a street they are, read from an extract and kept with the world."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from shapely import LineString

from pavetwin.world.build import BuildOptions, Built, build_world
from pavetwin.world.content import content_hash
from pavetwin.world.osm import bridges_on
from pavetwin.world.store import load_world, save_world

STREET = LineString([(0, 0), (60, 0), (100, 40)])
EXTRACT = """<?xml version='1.0' encoding='UTF-8'?>
<osm version="0.6" generator="by hand">
<node id="1" version="1" lat="50.0" lon="8.0000"/><node id="2" version="1" lat="50.0" lon="8.0010"/>
<node id="3" version="1" lat="50.0" lon="8.0015"/><node id="4" version="1" lat="50.0" lon="8.0030"/>
<way id="10" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/><tag k="name" v="High"/></way>
<way id="11" version="1"><nd ref="2"/><nd ref="3"/><tag k="highway" v="residential"/><tag k="name" v="High"/>
<tag k="bridge" v="yes"/><tag k="layer" v="1"/></way>
<way id="12" version="1"><nd ref="3"/><nd ref="4"/><tag k="highway" v="residential"/><tag k="name" v="High"/></way>
</osm>
"""


@cache
def built() -> Built:
    with TemporaryDirectory() as folder:
        source = Path(folder) / "bridge.osm"
        source.write_text(EXTRACT, encoding="utf-8")
        return build_world(source, BuildOptions(seed=1))


def test_a_bridge_is_where_its_way_lies_beside_the_centre_line() -> None:
    assert bridges_on(STREET, [LineString([(40, 2), (20, 2)])]) == ((20.0, 40.0),)
    assert bridges_on(STREET, [LineString([(40, 30), (20, 30)])]) == ()
    across = LineString([(30, -20), (30, 20)])
    assert bridges_on(STREET, [across]) == ()


def test_a_way_that_goes_on_beyond_the_street_counts_as_far_as_it_follows_it() -> None:
    assert bridges_on(STREET, [LineString([(-40, 0), (25, 0)])]) == ((0.0, 25.0),)


def test_a_bridge_of_an_extract_is_kept_with_the_world(tmp_path: Path) -> None:
    streets = [street for street in built().world.streets if street.bridges]
    assert streets
    total_m = sum(last - first for street in streets for first, last in street.bridges)
    assert 30.0 < total_m < 42.0
    assert load_world(save_world(built(), tmp_path / "town").folder or "").streets == built().world.streets


def test_bridges_are_not_part_of_the_content() -> None:
    world = built().world
    other = replace(world, streets=tuple(replace(street, bridges=()) for street in world.streets))
    assert other != world
    assert content_hash(other, "") == content_hash(world, "")
