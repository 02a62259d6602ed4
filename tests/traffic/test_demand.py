"""Demand: levels of service, names of traffic, mixes of vehicles, and a user's own routes."""

import gzip
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.scene.appearance import vehicle_model
from pavetwin.traffic.demand import (
    DEFAULT_MIX,
    DENSITIES,
    HOURLY_SHARES,
    LEVEL_PEDESTRIANS,
    LevelOfService,
    density_named,
    hour_density,
    kinds_of,
    level_density,
    level_of,
    mix_named,
    mix_names,
    own_demand,
    share_of_busiest,
)
from pavetwin.traffic.kinds import KINDS, OTHER_VEHICLES, PEDESTRIANS, VEHICLES, sumo_types
from pavetwin.traffic.record import record
from scenes import HERE
from scenes.traffic import scene_world


@pytest.mark.parametrize(
    ("ratio", "level"),
    [
        *((1.1, "A"), (0.81, "A"), (0.80, "B"), (0.68, "B"), (0.67, "C"), (0.51, "C"), (0.50, "D"), (0.41, "D")),
        *((0.40, "E"), (0.31, "E"), (0.30, "F"), (0.0, "F")),
    ],
)
def test_the_thresholds_are_those_of_the_manual(ratio: float, level: str) -> None:
    assert level_of(ratio) == level
    assert [each for each in LevelOfService if each.holds(ratio)] == ([level] if ratio > 0 else [])


def test_the_target_is_the_middle_of_what_a_network_can_reach() -> None:
    assert LevelOfService.C.target(0.72) == pytest.approx(0.585)
    assert LevelOfService.B.target(0.72) == pytest.approx((0.67 + 0.72) / 2)
    assert LevelOfService.A.target(0.95) == pytest.approx((0.80 + 0.95) / 2)
    assert LevelOfService.F.target(0.72) == pytest.approx(0.20)
    assert LevelOfService.F.target(0.24) == pytest.approx(0.16)


def test_a_name_holds_level_hour_and_mix() -> None:
    asked = density_named("los-c+south_asia")
    assert (asked.level, asked.hour, asked.mix, asked.is_found) == (LevelOfService.C, None, "south_asia", True)
    assert asked.vehicles_per_lane_km is None
    assert density_named("los-C", "south_asia") == asked == density_named(asked.name)
    assert density_named("hour-8").name == "hour-08"
    assert density_named("high+east_asia").vehicles_per_lane_km == 30
    assert density_named("high") is DENSITIES["high"]
    assert not density_named("high").is_found
    assert density_named("high", "europe") is DENSITIES["high"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("los-G", "no level of service 'G'.*known are A, B, C, D, E, F"),
        ("hour-24", "expected a whole number from 0 to 23"),
        ("los-C+asia", r"no mix of vehicles 'asia' \(did you mean '\w*asia'\?\)"),
        ("loss-C", r"did you mean 'los-C'\?"),
    ],
)
def test_an_unknown_name_gets_a_hint(name: str, message: str) -> None:
    with pytest.raises(PaveTwinError, match=message):
        density_named(name)


def test_two_mixes_contradict_each_other() -> None:
    with pytest.raises(PaveTwinError, match="has the mix south_asia"):
        density_named("los-C+south_asia", "east_asia")


def test_the_daily_curve_is_a_whole_day() -> None:
    assert len(HOURLY_SHARES) == 24
    assert sum(HOURLY_SHARES) == pytest.approx(100.0, abs=0.5)
    assert share_of_busiest(17) == 1.0
    assert share_of_busiest(3) < 0.04
    assert hour_density(3).pedestrians_per_sidewalk_km < 0.05 * level_density("C").pedestrians_per_sidewalk_km
    assert level_density("E").pedestrians_per_sidewalk_km == LEVEL_PEDESTRIANS


def test_the_default_mix_is_that_of_the_densities() -> None:
    assert mix_names()[0] == DEFAULT_MIX
    assert mix_named(DEFAULT_MIX).vehicles == tuple((kind, kind.share) for kind in VEHICLES)
    assert sumo_types(kinds_of(DEFAULT_MIX)) == sumo_types()
    assert sumo_types().count("<vType") == len(VEHICLES) + len(PEDESTRIANS)


@pytest.mark.parametrize("name", mix_names())
def test_every_mix_names_its_sources(name: str) -> None:
    mix = mix_named(name)
    assert sum(mix.shares.values()) == pytest.approx(1.0)
    assert all(len(source) > 40 for source in (*mix.sources, mix.ours))


def test_every_further_kind_is_in_a_mix_and_drawn_with_a_model_that_exists() -> None:
    named = {kind for name in mix_names() for kind in mix_named(name).shares}
    for kind in OTHER_VEHICLES:
        assert kind.name in named
        model = vehicle_model(kind.name, np.array([kind.length_m, kind.width_m, kind.height_m]))
        assert model == kind.model
        assert not KINDS[model].model  # it has one of its own


def test_vehicles_on_the_streets_follow_the_mix(tmp_path: Path) -> None:
    world = scene_world("cross", tmp_path, sidewalks=False)
    made = record(world, "v40-p0+south_asia", 1, 300.0)
    assert made.name == "v40-p0+south_asia"
    kinds = Counter(made.agents.kind)
    two_wheelers = (kinds["scooter"] + kinds["motorcycle"]) / kinds.total()
    assert two_wheelers == pytest.approx(0.5, abs=0.12)
    assert kinds["auto_rickshaw"] / kinds.total() == pytest.approx(0.10, abs=0.06)
    first = made.agents.kind.index("auto_rickshaw")
    assert made.agents.length_m[first] == pytest.approx(2.64)


def vehicles(*departures: object) -> str:
    rows = "".join(
        f'<vehicle id="{number}" depart="{at}"><route edges="wc ce"/></vehicle>' for number, at in enumerate(departures)
    )
    return f"<routes>{rows}</routes>"


@pytest.mark.parametrize(
    ("text", "begin_s", "warm_up_s"),
    [
        (vehicles(0, 3600), 0, 300),
        (vehicles(3600.5, 3700), 3600, 100),
        (vehicles("1:00:00", "1:00:20"), 3600, 20),
        (vehicles(7), 7, 0),
        ('<routes><flow id="f" begin="60" end="160" number="5" from="wc" to="ce"/></routes>', 60, 100),
        ('<routes><flow id="f" begin="60" period="5" from="wc" to="ce"/></routes>', 60, 300),
        ('<additional><trip id="t" depart="0" from="wc" to="ce"/></additional>', 0, 0),
        ('<routes><person id="p" depart="5"><walk edges="wc ce"/></person></routes>', 5, 0),
    ],
)
def test_missions_take_off_after_a_warm_up(tmp_path: Path, text: str, begin_s: float, warm_up_s: float) -> None:
    plain, packed = tmp_path / "a.rou.xml", tmp_path / "a.rou.xml.gz"
    plain.write_text(text)
    packed.write_bytes(gzip.compress(text.encode()))
    for file in (plain, packed):
        demand = own_demand([file])
        assert (demand.begin_s, demand.warm_up_s) == (begin_s, warm_up_s)
    late = tmp_path / "late.rou.xml"
    late.write_text(vehicles(50_000))
    assert own_demand([plain, late]).warm_up_s == 300


def test_what_holds_no_vehicle_is_refused_by_its_kind(tmp_path: Path) -> None:
    net = tmp_path / "roads.net.xml"
    net.write_text('<net version="1.20"/>')
    none, types, odd = tmp_path / "none.rou.xml", tmp_path / "types.rou.xml", tmp_path / "odd.xml"
    none.write_text("<routes/>")
    types.write_text('<routes><vType id="car"/><route id="r" edges="wc"/></routes>')
    odd.write_text("<gpx/>")
    table = tmp_path / "high-1.parquet"
    table.write_bytes(b"PAR1....")
    for file, words in (
        (HERE / "cross.osm", "is an OpenStreetMap map, not a routes file of SUMO: it holds no vehicle"),
        (net, "is a SUMO network"),
        (none, "is a routes file of SUMO, but holds no vehicle"),
        (types, "holds no vehicle"),
        (odd, "is XML with the root <gpx>"),
        (table, "is a Parquet table"),
    ):
        with pytest.raises(PaveTwinError, match=words) as caught:
            own_demand([file])
        assert str(file) in str(caught.value)


def test_a_recording_of_ones_own_demand_knows_its_warm_up(tmp_path: Path) -> None:
    cross, routes = scene_world("cross", tmp_path), tmp_path / "mine.rou.xml"
    routes.write_text(vehicles(0, 4, 30))
    recorded = record(cross, None, 1, 40.0, routes=[routes])
    assert recorded.warm_up_s == 20.0  # in the first half
    assert recorded.until(16.0).warm_up_s == 4.0
    assert recorded.agents_at(0.0) == (1, 0)
    assert recorded.agents_at(5.0) == (2, 0)
    assert record(cross, "low", 1, 10.0).warm_up_s == 0.0
