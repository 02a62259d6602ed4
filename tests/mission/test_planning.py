"""Planning of missions: choice and reach of segments, the estimate before take-off, and the traffic recorded for it."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import box

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission import inputs
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.estimate import estimate
from pavetwin.mission.inputs import load_inputs
from pavetwin.mission.metrics import totals
from pavetwin.mission.mission import Mission
from pavetwin.mission.planning import check_reach, choose_targets, plan_mission, ways_out
from pavetwin.mission.replay import FIRST_DURATION_S, FIRST_PER_TARGET_S
from pavetwin.mission.track import MODES
from pavetwin.traffic.area import TrafficArea
from pavetwin.twin import Mode
from pavetwin.uav import camera_of
from pavetwin.world.model import Junction
from scenes import damaged, tiny
from scenes.tiny import Scene, street, world

NAMES = ("Bell Lane", "Hill", "Bell Lane")


@pytest.fixture(scope="module")
def environment() -> MissionEnvironment:
    """Three pieces of one street in a row, the middle one of another name."""
    pieces = [street(name, (50 * k, 0), (50 * k + 50, 0)) for k, name in enumerate(("s0001", "s0002", "s0003"))]
    named = [replace(piece, street=name) for piece, name in zip(pieces, NAMES, strict=True)]
    return prepare(world(named), load_settings())


def test_a_street_stands_for_all_its_segments(environment: MissionEnvironment) -> None:
    assert choose_targets(environment, names=["Bell Lane"]) == [0, 2]
    assert choose_targets(environment, names=["s0002", "bell lane"]) == [1, 0, 2]


def test_a_segment_and_its_street_are_the_same_place(environment: MissionEnvironment) -> None:
    with pytest.raises(PaveTwinError, match="`names` Bell Lane, s0003: given more than once"):
        choose_targets(environment, names=["s0003", "s0002", "Bell Lane"])


FAR = world(
    [street("near", (60, 0), (100, 0)), street("far", (600, 0), (660, 0))],
    junctions=[Junction("way", "x", box(-5, -5, 600, 5))],
)


def refused(*overrides: str, segments: tuple[str, ...] = ("far",)) -> str:
    with pytest.raises(PaveTwinError) as caught:
        plan_mission(FAR, load_settings("default", overrides), segments=segments, base=(0.0, 0.0))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_plan_that_no_battery_can_fly_is_refused_with_what_would_help() -> None:
    reported = refused("energy.capacity_wh=5")
    assert reported.startswith("One battery is too small for 'far': 66")
    assert "m out and as far back at 10 m take a DJI Mavic 3 Enterprise at least " in reported
    assert "% of its usable energy, and a flight may use 85 %." in reported
    assert "Take off nearer to it (`base`), leave it out, fly another `aircraft` or with more energy" in reported


def test_the_wind_is_named_where_there_is_one() -> None:
    reported = refused("energy.capacity_wh=7.5", "conditions.wind_mps=11", "conditions.wind_from_deg=270")
    assert "at 10 m in a wind of 11 m/s take" in reported
    assert "wait for less wind" in reported
    plan_mission(FAR, load_settings("default", ["energy.capacity_wh=7.5"]), segments=("far",), base=(0.0, 0.0))


def test_what_is_near_enough_is_not_refused_and_the_rest_is_counted() -> None:
    small = ["energy.capacity_wh=5"]
    assert plan_mission(FAR, load_settings("default", small), segments=("near",), base=(0.0, 0.0)).targets == ("near",)
    assert "too small for 'far': " in refused(*small, segments=("near", "far"))
    tiny = refused("energy.capacity_wh=0.5", segments=("near", "far"))
    assert tiny.startswith("One battery is too small for 2 of 2 segments, the farthest of them 'far': ")


@pytest.mark.parametrize(
    "worse",
    [
        ("energy.reserve=0.6",),
        ("altitude_m=120",),
        ("energy.health=0.5",),
        ("conditions.temperature_c=-20",),
        ("energy.usable=0.4",),
        ("energy.payload_kg=1",),
        ("conditions.wind_mps=11", "conditions.wind_from_deg=90"),
    ],
)
def test_whatever_takes_energy_counts(worse: tuple[str, ...]) -> None:
    enough = "energy.capacity_wh=8"
    scene = Scene(FAR, altitude_m=10.0)
    for overrides, fits in (((enough,), True), ((enough, *worse), False)):
        settings = load_settings("default", overrides)
        environment = scene.environment(settings)
        if fits:
            check_reach(environment, settings, [1])
        else:
            with pytest.raises(PaveTwinError, match="One battery is too small for 'far'"):
                check_reach(environment, settings, [1])


@pytest.mark.parametrize("wind_from_deg", [0, 90, 180, 270])
@pytest.mark.parametrize("preset", ["default", "paper"])
def test_no_flight_takes_less_than_its_lower_bound(preset: str, wind_from_deg: int) -> None:
    """The energy of a real mission, up to its arrival and on its way home, is never below the bound."""
    wind = ("conditions.wind_mps=6", f"conditions.wind_from_deg={wind_from_deg}")
    scene = Scene(FAR, altitude_m=10.0)
    flown = scene.fly("baseline", *wind, preset=preset)
    (alone,) = ways_out(flown.environment, flown.settings, [1])
    landed = flown.track["mode"] == MODES.index(Mode.LAND)
    assert landed.any()
    assert flown.swaps == 0
    assert alone.needed < flown.energy
    assert alone.needed > 0.5 * flown.energy
    assert alone.distance_m == pytest.approx(660 - flown.environment.world.base.x, abs=8.0)


@pytest.mark.parametrize("capacity_wh", np.arange(4.0, 9.0, 0.5))
def test_what_is_refused_before_take_off_fails_in_flight(capacity_wh: float) -> None:
    scene = Scene(FAR, altitude_m=10.0)
    settings = scene.settings(f"energy.capacity_wh={capacity_wh}")
    environment = scene.environment(settings)
    try:
        check_reach(environment, settings, [1])
    except PaveTwinError:
        with pytest.raises(PaveTwinError, match="One battery is too small"):
            Mission(environment, scene.traffic(), settings, [1]).advance_until(np.inf)


@pytest.mark.parametrize("name", ["phantom4", "phantom4pro", "mavic3e", "matrice350"])
def test_wind_from_every_side_costs_energy_there_and_back(name: str) -> None:
    """Out and back along the street takes most with the wind along it, and never less than in calm."""
    scene = Scene(FAR, altitude_m=10.0)
    needed = {}
    for wind_from_deg in (None, 0, 90, 180, 270):
        wind = [] if wind_from_deg is None else ["conditions.wind_mps=8", f"conditions.wind_from_deg={wind_from_deg}"]
        settings = scene.settings(f"aircraft={name}", *wind)
        (way,) = ways_out(scene.environment(settings), settings, [1])
        needed[wind_from_deg] = way.needed
    assert needed[0] == pytest.approx(needed[180], rel=0.01)
    assert needed[90] == pytest.approx(needed[270], rel=0.01)
    assert needed[None] < needed[0] < needed[90]


def test_the_way_is_as_the_aircraft_flies_it_and_not_the_beeline() -> None:
    """A street that leads back: the end nearest to the base as the crow flies is the farthest to fly to."""
    bend = [Junction("out", "x", box(-5, -5, 305, 5)), Junction("round", "x", box(295, 5, 305, 125))]
    scene = Scene(world([street("back", (295, 120), (20, 120))], junctions=bend, base=(0.0, 0.0)), altitude_m=10.0)
    settings = scene.settings()
    (way,) = ways_out(scene.environment(settings), settings, [0])
    assert way.distance_m == pytest.approx(300 + 120 + 280, abs=40.0)


def test_over_empty_streets_the_estimate_is_what_a_mission_takes() -> None:
    flown = tiny.result("empty_street", "baseline")
    known, sums = estimate(flown.environment, flown.settings, [0]), totals(flown)
    assert (known.time_s, known.energy, known.batteries) == (sums.time_s, sums.energy, sums.batteries)
    assert known.images == len(flown.captures["t_s"])
    assert known.surface_coverage == sums.surface_coverage
    assert known.length_m == flown.rows[0].length_m
    assert known.pixel_mm == 1000 * camera_of(flown.settings).ground_resolution_m(flown.settings.altitude_m)


def test_waits_and_hidden_surface_are_left_out() -> None:
    flown = tiny.result("queue_at_light", "hover")
    known, sums = estimate(flown.environment, flown.settings, [0]), totals(flown)
    assert sums.wait_s > 0
    assert known.time_s < sums.time_s
    assert known.surface_coverage >= (sums.surface_coverage or 0.0)


def test_the_policys_options_and_the_sensor_do_not_matter() -> None:
    flown = tiny.result("empty_street", "baseline")
    other = load_settings(
        altitude_m=flown.settings.altitude_m,
        sensing={"sensor": "detector"},
        policy={"options": {"max_wait_s": 5.0}},
    )
    plain = load_settings(altitude_m=flown.settings.altitude_m)
    assert estimate(flown.environment, other, [0]) == estimate(flown.environment, plain, [0])


class RecordingAsked(Exception):  # noqa: N818 - no failure
    pass


@pytest.mark.parametrize(
    ("segments", "expected_s"), [(1, FIRST_PER_TARGET_S), (2, 2 * FIRST_PER_TARGET_S), (None, FIRST_DURATION_S)]
)
def test_as_much_traffic_is_recorded_as_the_segments_need(
    segments: int | None, expected_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[TrafficArea | None, float]] = []

    def replay_of(*_: object, area: TrafficArea | None, first_s: float, **__: object) -> None:
        asked.append((area, first_s))
        raise RecordingAsked

    monkeypatch.setattr(inputs, "replay_of", replay_of)
    monkeypatch.setattr(inputs, "FIRST_DURATION_S", FIRST_DURATION_S if segments else 2.5 * FIRST_PER_TARGET_S)
    world = damaged("cross", 1).world
    spec = plan_mission(world, density="low", segments=segments, seed=1)
    with pytest.raises(RecordingAsked):
        load_inputs(spec, world=world)
    most_s = inputs.FIRST_DURATION_S
    assert asked == [(None, min(most_s, expected_s))]
    assert len(spec.targets) * FIRST_PER_TARGET_S > most_s or segments is not None
