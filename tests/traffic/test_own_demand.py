"""A user's own demand: its departures, when missions over it take off, and files that are not demand."""

import gzip
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import own_demand
from pavetwin.traffic.record import record
from scenes import HERE
from scenes.traffic import scene_world


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
