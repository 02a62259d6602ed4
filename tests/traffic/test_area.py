"""Areas of traffic: which streets belong to one, and that it has the traffic of its town."""

from collections.abc import Iterator
from math import inf

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.errors import PaveTwinError
from pavetwin.traffic import area as area_module
from pavetwin.traffic import demand_search, inputs, town_trips
from pavetwin.traffic.area import SQUARE_M, TrafficArea
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.demand_search import middle_of
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.job import SLOWEST_MPS, AreaTraffic, Trip
from pavetwin.traffic.record import Recorder, record
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import load_recording
from pavetwin.traffic.sumo_run import shares
from pavetwin.traffic.town_trips import observe, with_area_traffic
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.cache import cached
from pavetwin.world.model import LaneKind, World
from pavetwin.world.store import load_world, save_world

AT_LANES_M = 25.0
"""Distance from its lanes of an agent on a street or on the junction at its end."""


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder = tmp_path_factory.mktemp("grid") / "grid"
    save_world(build_world("grid", BuildOptions(seed=1)), folder)
    return load_world(folder)


def corner(world: World) -> str:
    """The segment furthest to the south-west."""
    return min(world.segments, key=lambda segment: sum(segment.centre_line.centroid.coords[0])).id


def far_corner(world: World) -> str:
    return max(world.segments, key=lambda segment: sum(segment.centre_line.centroid.coords[0])).id


def middle(world: World) -> str:
    """The segment nearest to the middle of the others."""
    places = {each.id: np.array(each.centre_line.centroid.coords[0]) for each in world.segments}
    mean = np.mean([*places.values()], axis=0)
    return min(places, key=lambda name: float(np.hypot(*(places[name] - mean))))


def area_of(world: World, *targets: str, distance_m: float = 100.0) -> TrafficArea:
    area = TrafficArea.around(world, targets, distance_m, most_share=2.0)
    assert area is not None
    return area


def streets(world: World, area: TrafficArea) -> shapely.Geometry:
    return shapely.union_all([lane.centre_line for lane in world.lanes if lane.edge in area.edges])


def test_an_area_holds_whole_streets_within_its_distance(grid: World) -> None:
    target = corner(grid)
    area = area_of(grid, target)
    assert not area.misses([grid.segment(target)])
    for street in grid.streets:
        assert len(set(street.edges) & set(area.edges)) in (0, len(street.edges))
    line = grid.segment(target).centre_line
    near = [street for street in grid.streets if street.centre_line.distance(line) < 100.0]
    assert {edge for street in near for edge in street.edges} <= set(area.edges)
    far = [street for street in grid.streets if street.centre_line.distance(line) > 100.0 + 2 * SQUARE_M]
    assert far
    assert not {edge for street in far for edge in street.edges} & set(area.edges)


def test_targets_of_a_square_share_their_area_and_its_file(grid: World) -> None:
    areas = {segment.id: area_of(grid, segment.id) for segment in grid.segments}
    assert 1 < len(set(areas.values())) < len(areas) / 2
    one, other = next((a, b) for a in areas for b in areas if a < b and areas[a] == areas[b])
    assert area_of(grid, one, other) == areas[one]
    paths = {Inputs.of(grid, "low", 1, area=areas[name]).path for name in (one, other)}
    assert len(paths) == 1


def test_an_area_of_most_of_the_town_is_the_town(grid: World) -> None:
    assert TrafficArea.around(grid, [corner(grid)], 100.0) is not None
    assert TrafficArea.around(grid, [corner(grid)], 2000.0) is None
    with pytest.raises(PaveTwinError, match="No segment 'nosuch'"):
        TrafficArea.around(grid, ["nosuch"], 100.0)


def test_an_area_is_part_of_what_a_recording_is_found_by(grid: World) -> None:
    narrow, wide = area_of(grid, corner(grid)), area_of(grid, corner(grid), distance_m=200.0)
    made = [Inputs.of(grid, "low", 1, area=area) for area in (None, narrow, wide)]
    assert len({each.hash for each in made}) == len({each.path for each in made}) == 3
    kept = Inputs.of(grid, "low", 1)
    assert kept.path.name == "low-1.parquet"


@pytest.fixture(scope="module", autouse=True)
def short_simulations() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(town_trips, "OBSERVED_S", 100.0)
        patch.setattr(inputs, "WARM_UP_S", (60.0, 60.0))
        yield


@pytest.fixture(scope="module")
def islands(grid: World) -> tuple[TrafficArea, Recording]:
    area = area_of(grid, corner(grid), far_corner(grid))
    return area, Recorder(Inputs.of(grid, "medium", 1, area=area)).until(60.0)


def per_km(recording: Recording, world: World, area: TrafficArea, *, walks: bool) -> float:
    """Vehicles on the driving lanes of an area, or pedestrians on its sidewalks, per kilometre of these."""
    kind = LaneKind.SIDEWALK if walks else LaneKind.DRIVING
    lanes = shapely.STRtree([lane.centre_line for lane in world.lanes_of(kind)])
    edges = np.array([lane.edge for lane in world.lanes_of(kind)])
    chosen = recording.agents.is_pedestrian[recording.agent] == walks
    nearest = lanes.nearest(shapely.points(recording.x[chosen], recording.y[chosen]))
    return np.count_nonzero(np.isin(edges[nearest], area.edges)) / recording.frames / area.length_km(world, kind)


@pytest.mark.slow
def test_an_area_has_the_vehicles_that_its_town_has_there(grid: World) -> None:
    town = record(grid, "medium", 1, 90.0)
    found = []
    for target in (corner(grid), middle(grid)):
        area = area_of(grid, target)
        here = Recorder(Inputs.of(grid, "medium", 1, area=area)).until(60.0)
        found.append([per_km(recording, grid, area, walks=False) for recording in (town, here)])
        assert per_km(here, grid, area, walks=True) == pytest.approx(60, rel=0.3)
    (outer_town, outer), (inner_town, inner) = found
    assert outer == pytest.approx(outer_town, rel=0.25)
    assert inner == pytest.approx(inner_town, rel=0.25)
    assert inner > 1.15 * outer


def test_traffic_stays_on_an_area_and_the_edges_at_its_border(
    grid: World, islands: tuple[TrafficArea, Recording]
) -> None:
    area, recording = islands
    assert area.length_km(grid) < 0.8 * grid.length_km(LaneKind.DRIVING)
    assert recording.origin.capacity.lanes_km == pytest.approx(area.length_km(grid))
    walks = recording.agents.is_pedestrian[recording.agent]
    places = shapely.points(recording.x, recording.y)
    here = streets(grid, area)
    assert shapely.distance(places[walks], here).max() < AT_LANES_M
    touching = [street.centre_line for street in grid.streets if street.centre_line.distance(here) < AT_LANES_M]
    assert shapely.distance(places[~walks], shapely.union_all([here, *touching])).max() < AT_LANES_M
    for target in (corner(grid), far_corner(grid)):
        island = area_of(grid, target)
        assert per_km(recording, grid, island, walks=False) > 5
        assert per_km(recording, grid, island, walks=True) == pytest.approx(60, rel=0.3)


def test_trips_are_observed_once_for_all_seeds_and_areas(grid: World, monkeypatch: pytest.MonkeyPatch) -> None:
    first, other = (
        Inputs.of(grid, "v3-p0", seed, area=area_of(grid, at))
        for seed, at in ((1, corner(grid)), (2, far_corner(grid)))
    )
    found = with_area_traffic(first).area_traffic
    assert found is not None
    assert found.trips
    path = cached(grid, "traffic/trips-v3-p0.npz")
    kept = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(town_trips, "SimulationProcess", None)
        assert with_area_traffic(first).area_traffic == found
        assert with_area_traffic(other).area_traffic != found
        observe(grid, density_named("v3-p0"))
    path.write_bytes(kept[: len(kept) // 2])
    assert with_area_traffic(first).area_traffic == found
    assert path.read_bytes() == kept


def test_in_a_small_town_vehicles_of_an_area_are_observed_on_all_streets(grid: World) -> None:
    assert grid.length_km(LaneKind.DRIVING) < 2 * area_module.OBSERVED_LEAST_KM
    made = Inputs.of(grid, "low", 1, area=area_of(grid, corner(grid)))
    assert made.observed_on is None


def test_in_a_city_they_are_observed_on_the_streets_around_it(grid: World, monkeypatch: pytest.MonkeyPatch) -> None:
    area = area_of(grid, corner(grid))
    whole = Inputs.of(grid, "v20-p0", 1, area=area)
    everywhere = with_area_traffic(whole).area_traffic
    least_km = 1.3 * area.length_km(grid)
    monkeypatch.setattr(area_module, "OBSERVED_SHARE", 1.3)
    monkeypatch.setattr(area_module, "OBSERVED_LEAST_KM", 0.5)
    monkeypatch.setattr(area_module, "MOST_SHARE", 0.95)
    made = Inputs.of(grid, "v20-p0", 1, area=area)
    around = made.observed_on
    assert around is not None
    assert set(area.edges) < set(around.edges)
    assert least_km <= around.length_km(grid) < 0.95 * grid.length_km(LaneKind.DRIVING)
    assert made.hash != whole.hash
    found = with_area_traffic(made).area_traffic
    assert found is not None
    assert everywhere is not None
    assert {edge for trip in found.trips for edge in trip.edges} <= set(around.edges)
    assert found.vehicles == pytest.approx(everywhere.vehicles, rel=0.35)
    assert cached(grid, f"traffic/trips-v20-p0-{around.name}.npz").is_file()


def test_a_recording_of_an_area_is_repeated_extended_and_read_as_such(
    grid: World, islands: tuple[TrafficArea, Recording]
) -> None:
    area, first = islands
    again = Recorder(Inputs.of(grid, "medium", 1, area=area), force=True).until(60.0)
    assert again.same_traffic(first)
    assert first.path is not None
    assert first.path.name == f"medium-1-{area.name}.parquet"
    read = load_recording(first.path, grid)
    assert read.origin.area == area
    assert read.remarks == first.remarks
    longer = Recorder.of(read, grid).until(70.0)
    assert longer.until(60.0).same_traffic(first)
    assert longer.origin.area == area
    assert record(grid, "medium", 1, 5.0).origin.area is None


def test_signals_outside_are_not_recorded(grid: World, islands: tuple[TrafficArea, Recording]) -> None:
    _, recording = islands
    controllers = {link.signal.controller for link in grid.connections if link.signal is not None}
    assert set(recording.signals) < controllers


def test_agents_are_divided_without_a_rest() -> None:
    assert shares(10, [1.0, 1.0, 1.0]) == [3, 4, 3]
    assert sum(shares(7, [0.2, 5.0, 0.1])) == 7
    assert shares(0, [1.0, 2.0]) == [0, 0]
    assert shares(5, [0.0]) == [0]


def test_a_large_world_is_searched_in_its_middle_alone(grid: World, monkeypatch: pytest.MonkeyPatch) -> None:
    assert middle_of(grid) is None
    total_km = grid.length_km(LaneKind.DRIVING)
    monkeypatch.setattr(demand_search, "SEARCHED_LANES_KM", total_km / 3)
    area = middle_of(grid)
    assert area is not None
    assert total_km / 3 <= area.length_km(grid) < total_km
    middle = np.median([segment.centre_line.centroid.coords[0] for segment in grid.segments], axis=0)
    assert streets(grid, area).distance(shapely.Point(middle)) < 100.0


LENGTH_M = dict.fromkeys("ABCDEF", 100.0)


def traffic(*trips: Trip, area: str = "BC", duration_s: float = 100.0) -> AreaTraffic:
    return AreaTraffic.of(trips, set(area), duration_s, LENGTH_M)


def trip(edges: str, *entered_s: float, left_s: float) -> Trip:
    return Trip("car", tuple(edges), entered_s, left_s)


def test_a_trip_is_cut_to_the_area_with_the_edges_before_and_behind_it() -> None:
    (part,) = traffic(trip("FABCDE", 10, 20, 30, 40, 50, 60, left_s=70)).trips
    assert part.edges == ("A", "B", "C", "D")
    assert part.entered_s == (20, 30, 40, 50, 60)
    assert part.is_new
    assert not part.departs


def test_a_trip_that_begins_and_ends_in_the_area_departs_there() -> None:
    (part,) = traffic(trip("BC", 10, 30, left_s=55)).trips
    assert part.edges == ("B", "C")
    assert part.entered_s == (10, 30, 55)
    assert part.departs


def test_a_trip_that_comes_back_is_cut_into_two() -> None:
    parts = traffic(trip("ABDEFCA", 0.5, 10, 20, 30, 40, 50, 60, left_s=70)).trips
    assert [part.edges for part in parts] == [("A", "B", "D"), ("F", "C", "A")]


def test_earlier_vehicles_are_present_but_do_not_enter() -> None:
    found = traffic(trip("ABCD", -inf, -inf, 20, 30, left_s=40))
    assert not found.trips[0].is_new
    assert found.present[:41] == (1,) * 40 + (0,)


def test_vehicles_on_their_way_keep_the_rest_of_it() -> None:
    found = traffic(trip("ABCD", 10, 20, inf, inf, left_s=100))
    (part,) = found.trips
    assert part.edges == ("A", "B", "C", "D")
    assert part.entered_s == (10, 20, 100, 100, 100)
    assert traffic(trip("AFBC", 10, 20, inf, inf, left_s=100)).trips[0].edges == ("F", "B", "C")
    assert not traffic(trip("AEFBC", 10, inf, inf, inf, inf, left_s=100)).trips


def test_streets_without_trips_are_empty() -> None:
    found = traffic(trip("DEF", 10, 20, 30, left_s=40))
    assert (found.trips, found.vehicles, found.speed_mps) == ((), 0.0, {})


def test_behind_the_area_vehicles_are_as_fast_as_the_towns() -> None:
    through = trip("ABCD", 10, 20, 30, 40, left_s=60)
    assert traffic(through).speed_mps == {"D": 5.0}
    others = trip("ED", 10, 20, left_s=60)
    assert traffic(through, others).speed_mps["D"] == pytest.approx(200 / 60)
    stuck = trip("CDA", 1, 2, inf, left_s=100)
    assert traffic(stuck).speed_mps == {"D": SLOWEST_MPS}


@given(
    st.lists(
        st.tuples(st.permutations("ABCDEF"), st.lists(st.integers(1, 40), min_size=7, max_size=7)),
        min_size=1,
        max_size=8,
    ),
    st.sets(st.sampled_from("ABCDEF"), min_size=1),
)
def test_the_time_that_trips_spend_on_an_area_is_kept(
    driven: list[tuple[list[str], list[int]]], area: set[str]
) -> None:
    trips, spent = [], 0.0
    for edges, steps in driven:
        times = [float(sum(steps[: at + 1])) for at in range(7)]
        trips.append(Trip("car", tuple(edges), tuple(times[:6]), times[6]))
        spent += sum(times[at + 1] - times[at] for at in range(6) if edges[at] in area)
    found = AreaTraffic.of(trips, area, 400.0, LENGTH_M)
    parts = [(part, at) for part in found.trips for at in range(len(part.edges))]
    inside = sum(part.entered_s[at + 1] - part.entered_s[at] for part, at in parts if part.edges[at] in area)
    assert inside == pytest.approx(spent)
    assert sum(found.present) == pytest.approx(sum(part.entered_s[-1] - part.entered_s[0] for part in found.trips))
