"""Segments tile the streets' carriageways."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString

from pavetwin.world.model import Lane, LaneKind
from pavetwin.world.roadnet import Edge, RoadNet
from pavetwin.world.segments import pair_edges, segment_key, segments_of, streets_of
from scenes import built, net_of

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
