"""Behaviour of simulated traffic: densities held, signals obeyed, people on sidewalks, bodies of the right size."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import unary_union

from pavetwin.traffic.closed_loop import TRIP_M, ClosedLoop, Roads, Sidewalks
from pavetwin.traffic.demand import DENSITIES, TOLERANCE, density_named
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.job import centre_of_front, yaw_of_heading
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import LaneKind, World
from scenes import built, tiny
from scenes.traffic import scene_world

DURATION_S = 120.0


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> World:
    return scene_world("cross", tmp_path_factory.mktemp("worlds"))


@pytest.fixture(scope="module")
def busy_cross(cross: World) -> Recording:
    return record(cross, "high", 1, DURATION_S)


def assert_held(recording: Recording) -> None:
    asked = recording.origin.asked
    assert asked is not None
    assert recording.vehicles_per_lane_km == pytest.approx(asked.vehicles_per_lane_km, rel=TOLERANCE)
    assert recording.pedestrians_per_sidewalk_km == pytest.approx(asked.pedestrians_per_sidewalk_km, rel=TOLERANCE)
    assert not [remark for remark in recording.remarks if "instead of" in remark]


@pytest.mark.parametrize("density", DENSITIES)
@pytest.mark.parametrize("scene", ["straight", "cross"])
def test_the_density_is_held_in_tiny_scenes(tmp_path: Path, scene: str, density: str) -> None:
    assert_held(record(scene_world(scene, tmp_path), density, 0, DURATION_S))


@pytest.mark.slow
@pytest.mark.parametrize("density", DENSITIES)
@pytest.mark.parametrize("town", ["berlin_neukoelln", "seattle_roosevelt"])
def test_the_density_is_held_in_real_towns(tmp_path: Path, town: str, density: str) -> None:
    made = built(town)
    (tmp_path / "roads.net.xml").write_bytes(made.network)
    recording = record(replace(made.world, folder=tmp_path), density, 1, 60.0)
    assert_held(recording)
    vehicles, pedestrians = recording.counts
    assert np.abs(vehicles - vehicles.mean()).max() <= max(
        3, 0.15 * vehicles.mean()
    )  # and all the time, not only on average
    assert np.abs(pedestrians - pedestrians.mean()).max() <= max(3, 0.1 * pedestrians.mean())


def test_a_world_without_sidewalks_has_no_pedestrians(tmp_path: Path) -> None:
    recording = record(scene_world("straight", tmp_path, sidewalks=False), "medium", 1, 20.0)
    assert not recording.agents.is_pedestrian.any()
    assert recording.pedestrians_per_sidewalk_km is None
    assert recording.remarks == ("the world has no sidewalks, so there are no pedestrians",)


def test_bodies_have_the_sizes_of_their_kinds(busy_cross: Recording) -> None:
    agents = busy_cross.agents
    assert len(set(agents.kind)) >= 8
    for i, name in enumerate(agents.kind):
        kind = KINDS[name]
        assert agents.length_m[i] == pytest.approx(kind.length_m)
        assert agents.width_m[i] == pytest.approx(kind.width_m)
        assert abs(agents.height_m[i] - kind.height_m) <= 2 * kind.height_sd_m + 1e-3
        assert agents.is_pedestrian[i] == (kind.sumo_class == "pedestrian")
    people = agents.height_m[agents.is_pedestrian]
    assert people.std() > 0.05


def test_every_agent_is_somewhere_once_a_step(busy_cross: Recording) -> None:
    step = np.repeat(np.arange(busy_cross.frames), np.diff(busy_cross.step_offsets))
    keys = step.astype(np.int64) * len(busy_cross.agents) + busy_cross.agent
    assert (np.diff(keys) > 0).all()
    assert np.isfinite(busy_cross.x).all()
    assert np.abs(busy_cross.yaw_rad).max() <= np.float32(np.pi)


def test_the_speed_is_that_of_the_motion(busy_cross: Recording) -> None:
    """Two independent ways: SUMO's speed, and the distance between steps, for vehicles on straight arms."""
    for agent in np.flatnonzero(~busy_cross.agents.is_pedestrian)[:40]:
        rows = np.flatnonzero(busy_cross.agent == agent)
        straight = (np.abs(busy_cross.x[rows]) > 30) | (np.abs(busy_cross.y[rows]) > 30)
        moved = np.hypot(np.diff(busy_cross.x[rows]), np.diff(busy_cross.y[rows])) / busy_cross.step_s
        both = straight[1:] & straight[:-1]
        assert moved[both] == pytest.approx(busy_cross.speed_mps[rows][1:][both], abs=0.15)


def test_vehicles_are_on_their_lanes(cross: World, busy_cross: Recording) -> None:
    drives = ~busy_cross.agents.is_pedestrian[busy_cross.agent]
    lanes = [lane.centre_line.buffer(0.3, cap_style="flat") for lane in cross.lanes_of(LaneKind.DRIVING)]
    on = unary_union([*lanes, *(junction.polygon for junction in cross.junctions)]).buffer(0.1)
    away = ~shapely.contains_xy(on, busy_cross.x[drives], busy_cross.y[drives])
    beyond = (np.abs(busy_cross.x[drives]) > 290) | (np.abs(busy_cross.y[drives]) > 240)  # half a body hangs out
    assert not (away & ~beyond).any()


def test_people_walk_on_sidewalks_and_crossings(cross: World, busy_cross: Recording) -> None:
    walks = busy_cross.agents.is_pedestrian[busy_cross.agent]
    x, y = busy_cross.x[walks], busy_cross.y[walks]
    ends = (np.abs(x) > 299) | (np.abs(y) > 249)  # SUMO's walking area leads around the end of a street
    ways = [lane.centre_line.buffer(lane.width_m / 2) for lane in cross.lanes_of(LaneKind.SIDEWALK)]
    places = [*ways, *(j.polygon for j in cross.junctions), *(c.polygon for c in cross.crossings)]
    assert (ends | shapely.contains_xy(unary_union(places).buffer(0.5), x, y)).all()
    roads = unary_union([lane.centre_line.buffer(1.2, cap_style="flat") for lane in cross.lanes_of(LaneKind.DRIVING)])
    zebras = unary_union([crossing.polygon for crossing in cross.crossings]).buffer(1.5)
    assert not shapely.contains_xy(roads.difference(zebras), x, y).any()
    assert shapely.contains_xy(zebras, x, y).any()


def _fronts(recording: Recording) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Per vehicle: steps, front bumper (n, 2), yaw."""
    step = np.repeat(np.arange(recording.frames), np.diff(recording.step_offsets))
    for agent in np.flatnonzero(~recording.agents.is_pedestrian):
        rows = np.flatnonzero(recording.agent == agent)
        yaw, half = recording.yaw_rad[rows], recording.agents.length_m[agent] / 2
        front = np.stack([recording.x[rows] + half * np.cos(yaw), recording.y[rows] + half * np.sin(yaw)], axis=-1)
        yield step[rows], front, yaw


def test_no_vehicle_crosses_a_red_stop_line(cross: World, busy_cross: Recording) -> None:
    (signal,) = busy_cross.signals.values()
    states = np.empty(busy_cross.frames, dtype=object)
    for step, state in signal:
        states[step:] = state
    links: dict[str, list[int]] = {}
    for connection in ElementTree.parse(cross.network_file).getroot().iter("connection"):
        if connection.get("tl") and connection.attrib["from"] in ("wc", "ec", "sc", "nc"):
            links.setdefault(connection.attrib["from"], []).append(int(connection.attrib["linkIndex"]))
    ends = {
        lane.edge: np.array(lane.centre_line.coords)[-2:]
        for lane in cross.lanes_of(LaneKind.DRIVING)
        if lane.edge in links
    }
    crossed = 0
    for steps, front, yaw in _fronts(busy_cross):
        for edge, (before, stop) in ends.items():
            along = (stop - before) / np.linalg.norm(stop - before)
            beyond = (front - stop) @ along
            aside = np.abs((front - stop) @ np.array([-along[1], along[0]]))
            heads = np.cos(yaw - np.arctan2(along[1], along[0])) > 0.99
            for k in np.flatnonzero((beyond[:-1] <= 0) & (beyond[1:] > 0) & (aside[:-1] < 1) & heads[:-1]):
                crossed += 1
                shown = {states[step][link] for step in steps[k : k + 2] for link in links[edge]}
                assert shown & set("Ggyu"), (
                    f"over the stop line of {edge} at step {steps[k + 1]} while it shows {shown}"
                )
    assert crossed > 20
    assert len(signal) > 4


EXITS = 6
TRIPS = 600


def goals(*, fastest: bool, length_m: float = TRIP_M + 1.0) -> Counter[str]:
    """The exits of many trips from one entry, to which the way to the last exit is the fastest; the way to the first
    is shorter than to the others."""

    def route(_start: str, goal: str, _kind: str, _depart: float, _mode: int) -> Any:
        number = int(goal)
        length = length_m - (300.0 if number == 0 else 0.0)
        return SimpleNamespace(edges=("entry", goal), length=length, travelTime=100.0 - number)

    count = EXITS + 1
    roads = Roads(
        ids=(*map(str, range(EXITS)), "entry"),
        length_m=np.full(count, 100.0),
        lanes=np.ones(count, dtype=np.int64),
        entries=np.array([EXITS]),
        exits=np.arange(EXITS),
        kerbsides=np.arange(count),
    )
    sumo = SimpleNamespace(simulation=SimpleNamespace(findRoute=route))
    walks = Sidewalks((), np.zeros(0), (), ())
    loop = ClosedLoop(sumo, roads, walks, 1, 0, np.random.default_rng(1), [("car", 1.0)], fastest_goals=fastest)
    return Counter(loop._trip(EXITS, "car")[-1] for _ in range(TRIPS))


def test_at_a_density_trips_lead_to_the_fastest_of_some_exits() -> None:
    assert goals(fastest=True)["5"] > 0.6 * TRIPS


def test_at_a_level_of_service_they_lead_to_all_exits_that_are_far_enough_alike() -> None:
    found = goals(fastest=False)
    assert found["0"] == 0
    assert {found[str(exit)] for exit in range(1, EXITS)} <= set(range(90, 151))


def test_where_no_exit_is_far_enough_they_lead_to_a_far_one() -> None:
    assert goals(fastest=False, length_m=TRIP_M - 50.0)["0"] < 0.01 * TRIPS


@pytest.mark.parametrize(
    ("traffic", "fastest"), [("high", True), ("v12-p40", True), ("los-C", False), ("hour-08", False)]
)
def test_levels_and_hours_prefer_no_exit(traffic: str, fastest: bool) -> None:
    assert Inputs(tiny.straight(), density_named(traffic), 0).prefers_fastest_goals is fastest


degrees = st.floats(0.0, 360.0)
metres = st.floats(-1e4, 1e4)


@given(degrees)
def test_yaw_points_where_the_heading_points(heading_deg: float) -> None:
    yaw = float(yaw_of_heading(heading_deg))
    assert -math.pi <= yaw <= math.pi
    east, north = math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg))
    assert (math.cos(yaw), math.sin(yaw)) == pytest.approx((east, north), abs=1e-9)


@given(degrees, metres, metres, st.floats(0.2, 20.0))
def test_the_front_is_half_a_length_ahead_of_the_centre(heading_deg: float, x: float, y: float, length: float) -> None:
    yaw = yaw_of_heading(heading_deg)
    centre = centre_of_front((x, y), yaw, length)
    ahead = np.array([math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg))])
    assert centre + ahead * length / 2 == pytest.approx(np.array([x, y]), abs=1e-6)


def test_many_bodies_at_once() -> None:
    centre = centre_of_front([(10.0, 0.0), (0.0, 10.0)], yaw_of_heading([90.0, 0.0]), [4.0, 12.0])
    assert centre == pytest.approx(np.array([[8.0, 0.0], [0.0, 4.0]]))
