"""Segments tile the streets' carriageways; names of streets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString

from pavetwin.errors import PaveTwinError
from pavetwin.world.content import content_hash
from pavetwin.world.model import Lane, LaneKind
from pavetwin.world.osm_file import latin_name
from pavetwin.world.roadnet import Edge, RoadNet
from pavetwin.world.segments import pair_edges, segment_key, segments_of, streets_of
from pavetwin.world.store import load_world, save_world
from scenes import built, net_of, scripts

TOWNS = ("cross", "berlin_neukoelln", "seattle_roosevelt")


def street_net(points: list[tuple[float, float]], lanes: int = 1, width_m: float = 3.2, both: bool = True) -> RoadNet:
    """A single street along points, with `lanes` a direction, no sidewalks."""
    axis = LineString(points)

    def edge(name: str, sign: float, start: str, end: str) -> Edge:
        made = []
        for index in range(lanes):
            line = axis.offset_curve(-sign * width_m * (lanes - index - 0.5), join_style="mitre")
            made.append(
                Lane(
                    f"{name}_{index}",
                    name,
                    index,
                    LaneKind.DRIVING,
                    line if sign > 0 else line.reverse(),
                    width_m,
                    13.9,
                )
            )
        return Edge(name, start, end, "", "", tuple(made), True)

    edges = {"e": edge("e", 1.0, "a", "b")}
    if both:
        edges["-e"] = edge("-e", -1.0, "b", "a")
    return RoadNet(edges, (), (), (), {}, {}, False)


bends = st.lists(st.floats(-0.6, 0.6), min_size=2, max_size=12)


@settings(max_examples=60, deadline=None)
@given(bends=bends, step=st.floats(12.0, 90.0), lanes=st.integers(1, 3), both=st.booleans(), longest=st.floats(40, 200))
def test_pieces_tile_a_bent_street(bends: list[float], step: float, lanes: int, both: bool, longest: float) -> None:
    headings = np.clip(np.cumsum(bends), -1.4, 1.4)
    points = np.concatenate([[[0.0, 0.0]], np.cumsum(step * np.stack([np.cos(headings), np.sin(headings)], 1), axis=0)])
    net = street_net([(float(x), float(y)) for x, y in points], lanes, both=both)
    streets = streets_of(net)
    assert len(streets) == 1
    segments = segments_of(streets, longest)
    surface = streets[0].polygon
    assert sum(segment.area_m2 for segment in segments) == pytest.approx(surface.area, rel=1e-9)
    assert shapely.union_all([segment.polygon for segment in segments]).symmetric_difference(surface).area < 1e-6
    lengths = [segment.length_m for segment in segments]
    assert max(lengths) <= longest + 1e-6
    assert min(lengths) >= 20 - 1e-6 or len(segments) == 1
    assert sum(lengths) == pytest.approx(streets[0].length_m)
    width = lanes * 3.2 * (2 if both else 1)
    for segment in segments:
        assert segment.polygon.is_valid
        assert segment.width_m == pytest.approx(width, rel=0.2)
        assert segment.polygon.buffer(0.3).contains(segment.centre_line)


@pytest.mark.parametrize("name", TOWNS)
def test_segments_of_a_town_tile_its_streets(name: str, tmp_path: Path) -> None:
    streets = streets_of(net_of(name, tmp_path))
    segments = segments_of(streets)
    areas = sum(segment.area_m2 for segment in segments)
    assert areas == pytest.approx(sum(street.polygon.area for street in streets), rel=1e-9)
    assert areas == pytest.approx(shapely.union_all([segment.polygon for segment in segments]).area, rel=1e-7)
    lanes = [lane for street in streets for edge in street.edges for lane in edge.carriageway]
    by_lanes = sum(lane.length_m * lane.width_m for lane in lanes)
    assert areas == pytest.approx(by_lanes, rel=0.03), "an independent way to the same area"
    assert all(segment.length_m <= 135 + 1e-6 for segment in segments)
    assert [segment.id for segment in segments] == [f"s{number:04d}" for number in range(1, len(segments) + 1)]


def test_the_two_directions_of_a_street_are_one_street(tmp_path: Path) -> None:
    pairs = pair_edges(net_of("cross", tmp_path).edges.values())
    for pair in pairs:
        if pair[0].name == "Hauptstraße":
            assert len(pair) == 2
            assert (pair[0].start, pair[0].end) == (pair[1].end, pair[1].start)
            assert not pair[0].id.startswith("-"), "a street runs as it was drawn"


def test_directions_with_a_wide_median_are_two_streets() -> None:
    net = street_net([(0, 0), (100, 0)])
    far = net.edges["-e"].lanes[0]
    moved = Lane(far.id, far.edge, far.index, far.kind, shapely.affinity.translate(far.centre_line, 0, 8), 3.2, 13.9)
    edges = {**net.edges, "-e": Edge("-e", "b", "a", "", "", (moved,), True)}
    assert len(pair_edges(net.edges.values())) == 1
    assert len(pair_edges(edges.values())) == 2


def test_widths_of_the_cross_are_those_of_its_lanes() -> None:
    widths = {segment.street: segment.width_m for segment in built("cross").world.segments}
    assert widths["Hauptstraße"] == pytest.approx(6.4, abs=0.1) or widths["Hauptstraße"] == pytest.approx(12.8, abs=0.1)
    assert widths["Bogen"] == pytest.approx(2.0 + 3.2 + 2.0, abs=0.05), "a parking lane on both sides"
    assert widths["Nebenstraße"] == pytest.approx(2.0 + 6.4 + 2.0, abs=0.05)


def test_the_bent_one_way_street_keeps_its_bend() -> None:
    pieces = [segment for segment in built("cross").world.segments if segment.street == "Bogen"]
    assert len(pieces) == 3
    start, end = pieces[0].centre_line.coords[0], pieces[-1].centre_line.coords[-1]
    assert sum(piece.length_m for piece in pieces) > 1.05 * float(np.hypot(end[0] - start[0], end[1] - start[1]))


def test_keys_are_distinct_and_do_not_depend_on_the_numbering() -> None:
    segments = built("seattle_roosevelt").world.segments
    assert len({segment_key(segment) for segment in segments}) == len(segments)


def test_a_segment_length_that_could_give_slivers_is_refused() -> None:
    with pytest.raises(ValueError, match="below 40"):
        segments_of((), 30.0)


@pytest.mark.parametrize("name", ["cross", "town", "berlin_neukoelln"])
def test_it_holds_every_segment_and_beyond_them_only_what_is_on_junctions(name: str) -> None:
    world = built(name).world
    segments = shapely.union_all([segment.polygon for segment in world.segments])
    assert segments.difference(world.carriageway.buffer(0.02)).area < 1e-6
    junctions = shapely.union_all([junction.polygon.buffer(8.0) for junction in world.junctions])
    beyond = world.carriageway.difference(segments.buffer(0.02))
    assert beyond.area > 10.0
    assert beyond.difference(junctions).area < 0.01 * beyond.area


def test_the_paved_corners_of_junctions_are_not_part_of_it() -> None:
    world = built("cross").world
    junctions = shapely.union_all([junction.polygon for junction in world.junctions])
    walks = [crossing.polygon for crossing in world.crossings]
    assert junctions.difference(world.carriageway).area > 20.0
    assert shapely.union_all(walks).difference(world.carriageway).area < 0.2 * shapely.union_all(walks).area


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"name": "Липовая улица", "name:en": "Linden Street", "int_name": "Lipovaya"}, "Lipovaya"),
        ({"name": "青石路", "name:zh-Latn-pinyin": "Qīngshí Lù"}, "Qīngshí Lù"),
        ({"name": "青石路", "name:ja_rm": "Seiseki", "alt_name": "青路"}, "Seiseki"),
        ({"name": "青石路", "alt_name": "青路"}, ""),
        ({"name": "青石路", "alt_name": "Bluestone"}, "Bluestone"),
        ({"name": "青石路 Bluestone", "name:en": "Bluestone"}, "Bluestone"),
        ({"name": "Rue Haute", "name:en": "High Street"}, ""),
        ({"name:en": "High Street"}, ""),
    ],
)
def test_a_name_in_latin_letters_is_taken_from_the_tags(tags: dict[str, str], expected: str) -> None:
    assert latin_name(tags) == expected


@pytest.mark.parametrize("script", scripts.TOWNS)
def test_a_world_keeps_both_names(script: str, tmp_path: Path) -> None:
    made, town = scripts.built(script), scripts.TOWNS[script]
    assert made.world.left_hand is town.left_hand
    names = {street.name: street.latin_name for street in made.world.streets}
    for tags in town.streets:
        assert names[tags["name"]] == latin_name(tags)
    assert load_world(save_world(made, tmp_path / "town").folder or "").streets == made.world.streets


def test_names_in_latin_letters_are_not_part_of_the_content() -> None:
    world = scripts.built("chinese").world
    other = replace(world, streets=tuple(replace(street, latin_name="") for street in world.streets))
    assert other != world
    assert content_hash(other, "") == content_hash(world, "")
    renamed = replace(world, streets=tuple(replace(street, name="x") for street in world.streets))
    assert content_hash(renamed, "") != content_hash(world, "")


def test_a_street_without_a_name_is_called_so() -> None:
    world = scripts.built("cyrillic").world
    (unnamed,) = (segment for segment in world.segments if not segment.has_street_name)
    assert unnamed.street == "104"
    assert not replace(unnamed, edges=("-104",)).has_street_name, "an edge against its drawing"
    assert unnamed.street_name == unnamed.label == f"unnamed street, {unnamed.id}"
    named = next(segment for segment in world.segments if segment.has_street_name)
    assert (named.street_name, named.label) == (named.street, f"{named.street}, {named.id}")


def test_segments_are_found_by_id_and_by_their_street() -> None:
    world = scripts.built("chinese").world
    street = [segment for segment in world.segments if segment.street == "青石路"]
    assert len(street) > 1
    for name in ("青石路", "Bluestone Road", " bluestone road"):
        assert list(world.segments_named(name)) == street
    assert world.segments_named(street[1].id) == (street[1],)


@pytest.mark.parametrize(
    ("name", "near"), [("Blustone Road", "'Bluestone Road'"), ("青石街", "'青石路'"), ("s1", "'s0001'")]
)
def test_an_unknown_name_gets_the_nearest(name: str, near: str) -> None:
    with pytest.raises(PaveTwinError, match=rf"No segment or street '{name}'.*did you mean {near}"):
        scripts.built("chinese").world.segments_named(name)


def test_the_edge_of_an_unnamed_street_is_no_name() -> None:
    with pytest.raises(PaveTwinError):
        scripts.built("chinese").world.segments_named("104")
