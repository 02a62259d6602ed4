"""`pavetwin traffic` and the option --traffic-area of missions."""

from pathlib import Path

import pytest
import yaml

from pavetwin.cli import flight_report
from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.errors import PaveTwinError
from pavetwin.mission import MissionInputs, fly, plan_mission, prepare, replay_of
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.cache import cached
from pavetwin.world.store import load_world, save_world
from scenes.command_line import pavetwin, plain_refusal
from scenes.traffic import make_network


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cli")
    net_file = make_network("cross", folder / "net" / "cross.net.xml")
    save_world(build_world(net_file, BuildOptions(anchor=(48.1, 11.5))), folder / "cross")
    return folder / "cross"


def test_a_recording_is_summarised_and_then_taken_from_the_cache(world: Path, tmp_path: Path) -> None:
    first = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1, "--duration", 30)
    assert first.returncode == 0, first.stderr
    assert "× real time" in first.stdout
    assert "vehicles per lane-km" in first.stdout
    file = cached(load_world(world), "traffic/low-1.parquet")
    assert str(file) in first.stdout
    assert load_recording(file).duration_s == 30.0
    assert not (world / "traffic").exists()
    again = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1, "--duration", 10)
    assert "Taken from the cache" in again.stdout
    own = tmp_path / "mine" / "low.parquet"
    written = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1, "--duration", 10, "-o", own)
    assert f"File: {own}" in written.stdout
    assert load_recording(own).duration_s == 10.0
    info = pavetwin("traffic", "info", file)
    assert info.returncode == 0
    assert "low traffic, seed 1, 30 s" in info.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--density", "hihg"), "did you mean 'high'?"),
        (("--density", "low", "--duration", "0"), "duration"),
        (("--density", "low", "--duration", "-3"), "duration"),
        (("--density", "low", "--seed", "-1"), "seed"),
        ((), "an amount of traffic"),
        (("--density", "low", "--vehicles-per-lane-km", "3"), "Choose one"),
        (("--vehicles-per-lane-km", "-3"), "from 0 up"),
        (("--vehicles-per-lane-km", "500"), "do not fit"),
        (("--routes", "nowhere.rou.xml"), "nowhere.rou.xml"),
    ],
)
def test_wrong_options_are_refused_in_one_line(world: Path, arguments: tuple[str, ...], words: str) -> None:
    before = sorted(world.rglob("*"))
    assert words in plain_refusal(pavetwin("traffic", "record", world, *arguments))
    assert sorted(world.rglob("*")) == before


def test_missing_worlds_and_recordings_are_refused(tmp_path: Path) -> None:
    for arguments in (("record", tmp_path / "none", "--density", "low"), ("info", tmp_path / "none.parquet")):
        plain_refusal(pavetwin("traffic", *arguments))


SHORT = ("--density", "low", "--seed", "1", "--no-map")


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("area") / "grid"
    save_world(add_defects(build_world("grid", BuildOptions(seed=1)), DefectOptions(per_segment=2)), folder)
    return folder


def corner(folder: Path) -> str:
    segments = load_world(folder).segments
    return min(segments, key=lambda segment: sum(segment.centre_line.centroid.coords[0])).id


def settings_of(folder: Path) -> dict[str, object]:
    values: dict[str, object] = yaml.safe_load((folder / "mission.yaml").read_text())["settings"]
    return values


@pytest.mark.slow
def test_a_mission_keeps_its_traffic_area_and_is_flown_again(grid: Path, tmp_path: Path) -> None:
    one = (*SHORT, "--segment", corner(grid), "--traffic-area")
    done = pavetwin("fly", grid, *one, "100", "-o", tmp_path / "near")
    assert done.returncode == 0, done.stderr
    assert "km of lanes, those within 100 m of what is inspected" in done.stdout
    assert settings_of(tmp_path / "near")["traffic_area_m"] == 100
    again = pavetwin("fly", "--again", tmp_path / "near" / "mission.yaml", "--no-map")
    assert again.returncode == 0, again.stderr
    assert "The same as the first time." in again.stdout
    whole = pavetwin("fly", grid, *one, "all", "-o", tmp_path / "all")
    assert whole.returncode == 0, whole.stderr
    assert "km of lanes" not in whole.stdout
    assert settings_of(tmp_path / "all")["traffic_area_m"] is None


def test_the_savings_of_an_area_in_a_large_town_are_printed(grid: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world, targets = load_world(grid), [corner(grid)]
    assert flight_report.whole_town_line(world, targets) == "", "a small one is recorded soon enough"
    monkeypatch.setattr(flight_report, "CITY_KM", 1.0)
    monkeypatch.setattr(flight_report, "STATED_AREA_M", 100.0)
    area = TrafficArea.around(world, targets, 100.0)
    assert area is not None
    printed = flight_report.whole_town_line(world, targets)
    assert f"--traffic-area 100 records only the {area.length_km(world):.1f} km around" in printed
    monkeypatch.setattr(flight_report, "STATED_AREA_M", 10_000.0)
    assert flight_report.whole_town_line(world, targets) == "", "an area that is most of the town is the town"


@pytest.mark.parametrize(
    ("given", "printed"),
    [
        ("-5", "--traffic-area: traffic needs 100 m of streets"),
        ("99", "--traffic-area: traffic needs 100 m of streets"),
        ("nan", "--traffic-area: traffic needs 100 m of streets"),
        ("near", "--traffic-area: expected metres or 'all', not 'near'."),
    ],
)
def test_invalid_distances_are_refused(grid: Path, given: str, printed: str) -> None:
    assert printed in plain_refusal(pavetwin("fly", grid, *SHORT, "--traffic-area", given))


def test_an_area_excludes_traffic_of_ones_own(grid: Path, tmp_path: Path) -> None:
    mine = pavetwin("fly", grid, "--routes", tmp_path / "x.rou.xml", "--traffic-area", "300")
    assert "--traffic-area and --routes exclude each other" in plain_refusal(mine)


@pytest.mark.slow
def test_a_recording_without_traffic_on_a_target_is_refused(grid: Path) -> None:
    world = load_world(grid)
    settings = load_settings(traffic_area_m=100.0)
    near = [corner(grid)]
    far = [max(world.segments, key=lambda segment: sum(segment.centre_line.centroid.coords[0])).id]
    environment = prepare(world, settings)
    specs = [
        plan_mission(world, settings, density="low", segments=each, seed=1, environment=environment)
        for each in (near, far)
    ]
    replay = replay_of(world, "low", 1, area=specs[0].area(world))
    path = replay.recording.path
    assert path is not None
    reported = plain_refusal(pavetwin("fly", grid, "--traffic", path, "--segment", far[0], "--no-map"))
    assert "no traffic on" in reported
    inputs = MissionInputs(environment, replay)
    assert fly(specs[0], inputs=inputs).spec.settings.traffic_area_m == 100
    with pytest.raises(PaveTwinError, match="area of the traffic"):
        fly(specs[1], inputs=inputs)
    whole = MissionInputs(environment, replay_of(world, "low", 1))
    assert fly(specs[1], inputs=whole).spec.settings.traffic_area_m is None
