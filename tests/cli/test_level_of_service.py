"""Traffic by level of service, hour and mix as a user types it: what is said, what is written, what is refused."""

import re
from functools import partialmethod
from pathlib import Path

import polars as pl
import pytest
import yaml

from pavetwin.traffic.demand_search import DemandSearch
from pavetwin.traffic.flow import flow_of
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.cache import cached
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.command_line import pavetwin, plain_refusal
from scenes.traffic import know_demand, on_the_curve


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("los") / "cross"
    save_world(damaged("cross", 4), folder)
    know_demand(load_world(folder), "europe", "south_asia")
    return folder


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """No trial is simulated, missions begin with a short recording, and no map is drawn."""
    monkeypatch.setattr(DemandSearch, "_simulated", lambda *_: pytest.fail("a trial was simulated"))
    monkeypatch.setattr("pavetwin.mission.replay.FIRST_DURATION_S", 60.0)
    monkeypatch.setattr("pavetwin.draw.mission_map.save_mission_map", lambda _, path: path.touch())


@pytest.fixture
def crowded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even the nearly empty network keeps only 46 % of the speed limits, as far as the search knows."""
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path / "crowded"))
    monkeypatch.setattr(DemandSearch, "_simulated", partialmethod(on_the_curve, empty_ratio=0.46))


def flown(world: Path, folder: Path, *traffic: object) -> str:
    done = pavetwin("fly", world, "--segments", 1, "--policy", "baseline", *traffic, "-o", folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def density_of(folder: Path) -> str:
    return str(yaml.safe_load((folder / "mission.yaml").read_text())["traffic"]["density"])


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ((), "los-C"),
        (("--los", "e"), "los-E"),
        (("--hour", 8), "hour-08"),
        (("--mix", "south_asia"), "los-C+south_asia"),
    ],
)
def test_a_mission_prints_its_traffic(world: Path, tmp_path: Path, options: tuple[object, ...], name: str) -> None:
    printed = flown(world, tmp_path / "m", *options)
    (line,) = [line for line in printed.splitlines() if line.startswith(f"Traffic {name}: ")]
    assert "% of the speed limits: level of service" in line
    assert "of vehicles stand" in line
    assert "gridlock" in line
    assert density_of(tmp_path / "m") == name


@pytest.mark.usefixtures("crowded")
def test_the_usual_level_out_of_reach_is_replaced_and_one_asked_for_is_refused(world: Path, tmp_path: Path) -> None:
    printed = flown(world, tmp_path / "m")
    assert (
        "Level of service C, the usual one, cannot be reached in 'cross'; using D, the nearest one. "
        "Choose another with --los." in printed
    )
    assert "Traffic los-D: " in printed
    traffic = yaml.safe_load((tmp_path / "m" / "mission.yaml").read_text())["traffic"]
    assert (traffic["density"], traffic["instead_of"], traffic["or_nearest"]) == ("los-D", "los-C", False)
    again = pavetwin("fly", "--again", tmp_path / "m" / "mission.yaml", "-o", tmp_path / "again")
    assert "The same as the first time." in again.stdout
    assert "cannot flow at level of service C" in plain_refusal(pavetwin("fly", world, "--los", "C"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--los", "G"), "no level of service 'G'"),
        (("--hour", "24"), "expected a whole number from 0 to 23"),
        (("--mix", "south_asai"), "no mix of vehicles 'south_asai' (did you mean 'south_asia'?)"),
        (("--los", "C", "--hour", "8"), "--los and --hour exclude each other; give one of them."),
        (("--los", "C", "--density", "high"), "--los exclude each other; give one of them."),
        (("--los", "A"), "cannot flow at level of service A (above 80 % of the speed limits) in 'cross': even nearly "
         "empty streets allow 7"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused_in_one_line(
    world: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    assert words in plain_refusal(pavetwin("fly", world, *options, "-o", tmp_path / "m"))
    assert not (tmp_path / "m").exists()
    if "--density" not in options:
        assert words in plain_refusal(pavetwin("traffic", "record", world, *options, "--duration", 10))


def test_routes_of_ones_own_have_no_level(world: Path, tmp_path: Path) -> None:
    (tmp_path / "own.rou.xml").write_text("<routes/>")
    for options in (("--los", "C"), ("--mix", "south_asia"), ("--hour", "8")):
        line = plain_refusal(pavetwin("fly", world, "--routes", tmp_path / "own.rou.xml", *options))
        assert f"{options[0]} and --routes exclude each other" in line


def test_a_recording_is_of_its_level_and_its_mix(world: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.parquet"
    done = pavetwin("traffic", "record", world, "--los", "D", "--mix", "south_asia", "--duration", 60, "-o", own)
    assert done.returncode == 0, done.stderr
    assert "los-D+south_asia traffic, seed 0, 60 s" in done.stdout
    recording = load_recording(own, load_world(world))
    assert recording.origin.asked is not None
    assert (recording.origin.asked.level, recording.origin.asked.mix) == ("D", "south_asia")
    assert {"scooter", "auto_rickshaw"} & set(recording.agents.kind)


def test_info_shows_the_level_of_service(world: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.parquet"
    assert pavetwin("traffic", "record", world, "--los", "E", "--duration", 60, "-o", own).returncode == 0
    assert "of the speed limits: level of service" in pavetwin("traffic", "info", own).stdout


@pytest.mark.slow
@pytest.mark.usefixtures("crowded")
def test_a_study_flies_and_reports_the_nearest_levels(world: Path, tmp_path: Path) -> None:
    design, folder = tmp_path / "design.yaml", tmp_path / "study"
    design.write_text(
        f"name: levels\nworlds: [{world}]\ndensities: [los-B, los-C]\nor_nearest: true\naltitudes_m: [10]\n"
        "policies: [baseline]\nreplicates: 1\nsegments: 1\n"
    )
    for _ in range(2):  # the same command resumes
        done = pavetwin("experiment", "run", design, "-o", folder)
        assert done.returncode == 0, done.stderr
    said = "Levels of service B and C are out of reach in 'cross'; the nearest are flown: D for B and D for C."
    assert said in done.stderr
    assert pl.read_parquet(folder / "segments.parquet")["traffic"].to_list() == ["los-D"]
    assert pavetwin("experiment", "report", folder).returncode == 0
    assert said.replace("'", "&#39;") in (folder / "report.html").read_text()


@pytest.mark.slow
def test_a_study_over_levels_and_mixes_reports_what_its_traffic_is(world: Path, tmp_path: Path) -> None:
    design, folder = tmp_path / "design.yaml", tmp_path / "study"
    design.write_text(
        f"name: levels\nworlds: [{{path: {world}}}]\ndensities: [los-C, los-E+south_asia]\naltitudes_m: [10]\n"
        "policies: [baseline]\nreplicates: 1\nsegments: 1\n"
    )
    done = pavetwin("experiment", "run", design, "-o", folder)
    assert done.returncode == 0, done.stderr
    table = pl.read_parquet(folder / "segments.parquet")
    assert pavetwin("experiment", "report", folder).returncode == 0
    (section,) = re.findall(r'<section id="traffic">.*?</section>', (folder / "report.html").read_text(), re.DOTALL)
    for traffic, seed in table.select("traffic", "traffic_seed").unique().rows():
        file = cached(load_world(world), f"traffic/{traffic}-{seed}.parquet")
        flow = flow_of(load_recording(file))
        (row,) = [row for row in re.findall(r"<tr>.*?</tr>", section, re.DOTALL) if f">{traffic}<" in row]
        cells = [re.sub("<[^>]*>", "", cell).strip() for cell in re.findall(r"<td.*?</td>|<th.*?</th>", row, re.DOTALL)]
        assert cells[-6:-3] == [f"{flow.speed_kmh:.0f}", f"{100 * flow.ratio:.0f} %", str(flow.level)]
        assert cells[-3:] == [
            f"{100 * flow.standing:.0f} %",
            f"{flow.flow_per_lane_h:.0f}",
            f"{flow.removed_per_vehicle_hour:.2f}",
        ]
