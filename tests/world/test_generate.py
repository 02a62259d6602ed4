"""Generated networks: valid whatever the seed, the same bytes for the same seed, and a town that looks like one."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from xml.etree import ElementTree

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin.errors import PaveTwinError
from pavetwin.world.generate import NetworkKind, SourceNetwork, generate_network
from pavetwin.world.georeference import from_location
from pavetwin.world.model import LaneKind
from pavetwin.world.roadnet import RoadNet, read_roadnet
from pavetwin.world.segments import segments_of, streets_of
from pavetwin.world.town_plan import faults, plan_town

TOWNS = [pytest.param(seed, marks=pytest.mark.slow) if seed > 2 else seed for seed in range(10)]

_FOLDER = TemporaryDirectory(prefix="pavetwin-test-")  # gone when the interpreter ends


@cache
def generated(kind: NetworkKind, seed: int) -> tuple[SourceNetwork, RoadNet]:
    network = generate_network(kind, seed, Path(mkdtemp(dir=_FOLDER.name)))
    return network, read_roadnet(network.net_file)


def drivable(net_file: Path) -> tuple[dict[str, set[str]], set[str]]:
    """Successors of each edge for cars, and all edges that cars may use; read from the XML, not through our reader."""
    root = ElementTree.parse(net_file).getroot()
    cars = set()
    for edge in root.iter("edge"):
        if edge.get("function") in (None, "normal") and any(
            lane.get("allow") != "pedestrian" for lane in edge.iter("lane")
        ):
            cars.add(edge.attrib["id"])
    onward: dict[str, set[str]] = {edge: set() for edge in cars}
    for connection in root.iter("connection"):
        if {connection.attrib["from"], connection.attrib["to"]} <= cars:
            onward[connection.attrib["from"]].add(connection.attrib["to"])
    return onward, cars


def reach(onward: dict[str, set[str]], origin: str) -> set[str]:
    seen, front = {origin}, [origin]
    while front:
        fresh = onward[front.pop()] - seen
        seen |= fresh
        front.extend(fresh)
    return seen


@pytest.mark.parametrize("seed", TOWNS)
def test_a_car_gets_from_every_street_of_the_town_to_every_other(seed: int) -> None:
    onward, cars = drivable(generated(NetworkKind.TOWN, seed)[0].net_file)
    backward: dict[str, set[str]] = {edge: set() for edge in cars}
    for edge, following in onward.items():
        for follower in following:
            backward[follower].add(edge)
    assert reach(onward, min(cars)) == cars
    assert reach(backward, min(cars)) == cars


@pytest.mark.parametrize("seed", TOWNS)
def test_carriageways_of_a_town_meet_at_junctions_only(seed: int) -> None:
    streets = streets_of(generated(NetworkKind.TOWN, seed)[1])
    shapes = [street.polygon.buffer(-0.1) for street in streets]
    tree = shapely.STRtree(shapes)
    for i, shape in enumerate(shapes):
        others = [shapes[j] for j in tree.query(shape, predicate="intersects") if j != i]
        assert not others, f"{streets[i].name} lies on another street"


@pytest.mark.parametrize("seed", TOWNS)
def test_junctions_of_a_town_are_of_human_size(seed: int) -> None:
    for junction in generated(NetworkKind.TOWN, seed)[1].junctions:
        assert junction.polygon.area < 1_100
        assert junction.polygon.area > 0.6 * junction.polygon.convex_hull.area


@pytest.mark.parametrize("seed", TOWNS)
def test_a_town_has_the_extent_and_the_mixture_it_promises(seed: int) -> None:
    network, net = generated(NetworkKind.TOWN, seed)
    lanes = [lane for edge in net.edges.values() for lane in edge.lanes]
    driving = [lane for lane in lanes if lane.kind is LaneKind.DRIVING]
    assert 5.0 < sum(lane.length_m for lane in driving) / 1000 < 9.0
    assert any(lane.kind is LaneKind.SIDEWALK for lane in lanes)
    assert {round(lane.speed_limit_mps * 3.6) for lane in driving} >= {30, 50}
    assert len({lane.width_m for lane in driving}) >= 4
    assert 40 <= len(segments_of(streets_of(net))) <= 75
    assert 2 <= len(set(net.signalled.values())) <= 3
    assert any(crossing.signalled for crossing in net.crossings)
    assert any(not crossing.signalled for crossing in net.crossings)
    assert len(network.parks) == 1
    assert 4_000 < network.parks[0].area < 30_000
    streets = {edge.name for edge in net.edges.values()}
    assert "" not in streets
    assert len(streets) > 10


@pytest.mark.parametrize("seed", TOWNS)
def test_houses_stand_clear_of_streets_sidewalks_park_and_each_other(seed: int) -> None:
    network, net = generated(NetworkKind.TOWN, seed)
    houses = [house.polygon for house in network.buildings]
    assert len(houses) > 250
    assert all(house.is_valid and house.area > 20 for house in houses)
    surfaces = [
        lane.centre_line.buffer(lane.width_m / 2, cap_style="flat")
        for edge in net.edges.values()
        for lane in edge.lanes
    ]
    surfaces += [junction.polygon for junction in net.junctions]
    tree = shapely.STRtree([*surfaces, *network.parks])
    assert len(tree.query(houses, predicate="intersects")[0]) == 0
    overlaps = shapely.STRtree(houses).query([house.buffer(-0.05) for house in houses], predicate="intersects")
    assert (overlaps[0] == overlaps[1]).all()
    heights = [house.height_m for house in network.buildings]
    assert min(heights) >= 2.5
    assert 20 < max(heights) < 40


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**63))
def test_every_seed_gives_a_plan_without_faults(seed: int) -> None:
    assert faults(plan_town(seed)) == []


def test_different_seeds_give_different_towns() -> None:
    assert len({generated(NetworkKind.TOWN, seed)[0].net_file.read_bytes() for seed in range(3)}) == 3


@pytest.mark.parametrize("kind", NetworkKind)
@pytest.mark.parametrize("seed", [0, 7])
def test_same_seed_same_bytes_and_no_trace_of_the_machine(kind: NetworkKind, seed: int, tmp_path: Path) -> None:
    network = generate_network(kind, seed, tmp_path)
    first, _ = generated(kind, seed)
    content = network.net_file.read_bytes()
    assert content == first.net_file.read_bytes()
    assert network.buildings == first.buildings
    for trace in (b"generated on", b"/tmp", str(tmp_path).encode(), b"<configuration"):
        assert trace not in content


@pytest.mark.parametrize("kind", [NetworkKind.GRID, NetworkKind.SPIDER, NetworkKind.RANDOM])
def test_netgenerate_kinds_have_sidewalks_crossings_signals_and_varied_lanes(kind: NetworkKind) -> None:
    _, net = generated(kind, 1)
    driving = {sum(lane.kind is LaneKind.DRIVING for lane in edge.lanes) for edge in net.edges.values()}
    assert len(driving) > 1
    assert net.crossings
    assert net.signalled
    assert any(lane.kind is LaneKind.SIDEWALK for edge in net.edges.values() for lane in edge.lanes)


@pytest.mark.parametrize("anchor", [(0.0, 0.0), (52.47, 13.44), (-33.9, 18.4)])
def test_the_network_states_the_georeference_it_was_given(anchor: tuple[float, float], tmp_path: Path) -> None:
    network = generate_network(NetworkKind.GRID, 3, tmp_path, anchor=anchor)
    lon, lat = network.georeference.to_wgs84((0.0, 0.0))
    assert (lat, lon) == pytest.approx(anchor, abs=1e-6)
    location = read_roadnet(network.net_file).location
    assert from_location(location, "here") == network.georeference
    assert len(location["origBoundary"].split(",")) == 4


def test_an_unknown_kind_is_refused_with_the_nearest_name(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="did you mean 'spider'"):
        generate_network("spidr", 1, tmp_path)
    with pytest.raises(PaveTwinError, match="negative"):
        generate_network("grid", -1, tmp_path)
    assert not list(tmp_path.iterdir())
