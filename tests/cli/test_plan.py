"""`pavetwin plan export` as a user types it."""

import json
import shutil
from pathlib import Path

import polars as pl
import pytest
import shapely
import yaml

from flightplan.readers import READERS
from pavetwin.config import load_settings
from pavetwin.flightplan import PLAN_FORMATS
from pavetwin.navigation.navmesh import navmesh, polygons
from pavetwin.world.georeference import from_wgs84
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.command_line import pavetwin, plain_refusal


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan")
    save_world(damaged("cross", 8), folder / "cross")
    flown = pavetwin(
        *("fly", folder / "cross", "--density", "low", "--segments", "2", "--policy", "baseline"),
        *("--seed", "1", "--no-map", "-o", folder / "m"),
    )
    assert flown.returncode == 0, flown.stderr
    return folder / "m"


def test_a_mission_becomes_a_plan_in_every_format(mission: Path, tmp_path: Path) -> None:
    formats = [word for name in READERS for word in ("--format", name)]
    done = pavetwin("plan", "export", mission, *formats, "-o", tmp_path, "--highest", "10")
    assert done.returncode == 0, done.stderr
    assert "The pilot is responsible" in done.stdout
    track = pl.read_parquet(mission / "track.parquet").filter(pl.col("altitude_m") >= 10)
    place = load_world(mission.parent / "cross").georeference
    suffixes = {"qgc": ".plan", "wpml": ".kmz", "litchi": "-litchi.csv", "csv": ".csv"}
    for name, read in READERS.items():
        points = read((tmp_path / f"flight-1{suffixes[name]}").read_bytes())
        line = shapely.LineString(from_wgs84(place, [(each.longitude, each.latitude) for each in points]))
        flown = shapely.points(track.select("x_m", "y_m").to_numpy())
        assert shapely.distance(line, flown).max() < 0.1
        assert {each.height_m for each in points} == {10}
        assert any(each.photographs for each in points)


def test_without_options_it_is_a_plan_for_qgroundcontrol_in_the_missions_folder(mission: Path) -> None:
    done = pavetwin("plan", "export", mission)
    assert done.returncode == 0, done.stderr
    assert json.loads((mission / "plan" / "flight-1.plan").read_text())["fileType"] == "Plan"


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--format", "qcg"), "Error: --format: no format of flight plans 'qcg' (did you mean 'qgc'?)"),
        (("--trigger", "speed"), "Error: --trigger speed: expected distance or time."),
        (("--drone", "mavic"), "Error: --drone: no drone of DJI's plans 'mavic'"),
        (("--highest", "9"), "Error: --highest 9: flight 1 goes up to 10 m above take-off"),
        (("--from-buildings", "500"), "Error: --from-buildings 500: flight 1 comes as near as "),
        (("--no-fly", "gone.gpkg"), "Error: --no-fly gone.gpkg: there is no such file."),
        (("--no-fly", "."), "Error: --no-fly .: it is a folder; name a file of polygons in it."),
    ],
)
def test_mistakes_and_broken_limits_are_one_line(
    mission: Path, tmp_path: Path, options: tuple[str, str], line: str
) -> None:
    assert plain_refusal(pavetwin("plan", "export", mission, *options, "-o", tmp_path / "out")).startswith(line)
    assert not (tmp_path / "out").exists()


def test_a_file_in_place_of_the_folder_is_refused(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("notes")
    reported = plain_refusal(pavetwin("plan", "export", mission, "-o", tmp_path / "out"))
    assert reported.endswith("it is a file; name a folder.")
    assert reported.startswith("Error: --output ")


def test_a_world_that_has_changed_is_refused(mission: Path, tmp_path: Path) -> None:
    shutil.copytree(mission, tmp_path / "m", ignore=shutil.ignore_patterns("plan"))
    description = (mission / "mission.yaml").read_text()
    changed = description.replace(str(mission.parent / "cross"), str(tmp_path / "cross"))
    assert changed != description
    (tmp_path / "m" / "mission.yaml").write_text(changed)
    save_world(damaged("cross", 7), tmp_path / "cross")
    reported = plain_refusal(pavetwin("plan", "export", tmp_path / "m"))
    assert reported.startswith("Error: The mission's inputs have changed: the world 'cross'")
    assert not (tmp_path / "m" / "plan").exists()


def test_a_folder_that_is_neither_mission_nor_world_is_refused(tmp_path: Path) -> None:
    assert "mission.yaml" in plain_refusal(pavetwin("plan", "export", tmp_path))


def test_a_selection_of_segments_has_the_plan_of_a_mission_that_never_reacts(mission: Path, tmp_path: Path) -> None:
    """Two ways to the same plan: with traffic, flown; without, from the world alone."""
    names = yaml.safe_load((mission / "mission.yaml").read_text())["targets"]
    segments = [word for name in names for word in ("--segment", name)]
    formats = ("--format", "csv", "--format", "qgc")
    world = mission.parent / "cross"
    done = pavetwin("plan", "export", world, *segments, "--order", "random", *formats, "-o", tmp_path / "chosen")
    assert done.returncode == 0, done.stderr
    assert "The pilot is responsible" in done.stdout
    assert pavetwin("plan", "export", mission, *formats, "-o", tmp_path / "flown").returncode == 0
    for name in ("flight-1.csv", "flight-1.plan"):
        assert (tmp_path / "chosen" / name).read_bytes() == (tmp_path / "flown" / name).read_bytes()


def test_options_of_a_world_are_refused_with_a_mission(mission: Path) -> None:
    reported = plain_refusal(pavetwin("plan", "export", mission, "--altitude", "12"))
    assert reported == f"Error: --altitude is for a world; the mission '{mission}' holds its own."


def test_parts_of_a_long_flight_leave_from_the_base_and_return_within_the_flight_domain(
    mission: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PLAN_FORMATS.get("litchi"), "most_waypoints", 25)
    done = pavetwin("plan", "export", mission.parent / "cross", "--format", "litchi", "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    world = load_world(mission.parent / "cross")
    domain = shapely.union_all(polygons(navmesh(world, 10.0, load_settings().uav.radius_m))).buffer(0.5)
    files = sorted(tmp_path.glob("flight-1-part-*-litchi.csv"))
    assert len(files) > 1
    assert f"{len(files)} files are parts of a flight. Each takes off and lands at the base" in done.stdout
    bases = set()
    for file in files:
        points = READERS["litchi"](file.read_bytes())
        assert len(points) <= 25
        xy = from_wgs84(world.georeference, [(each.longitude, each.latitude) for each in points])
        bases |= {tuple(xy[end].round(1).tolist()) for end in (0, -1)}
        assert domain.covers(shapely.LineString(xy[1:-1]))
    assert len(bases) == 1
