"""`pavetwin fly` as a user types it: its files, their bytes, and one plain line with exit code 2 for what is wrong."""

import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest
import yaml
from shapely import Point, union_all

from pavetwin.traffic import part_table
from pavetwin.world.cache import cached
from pavetwin.world.folder import read_description
from pavetwin.world.store import load_world, save_world
from scenes import HERE, built, damaged, drawn_detector
from scenes.command_line import command, pavetwin, pavetwin_process, plain_refusal, without_progress
from scenes.folders import digests
from scenes.processes import is_gone, is_over, simulations

SHORT = ("--density", "low", "--segments", "2", "--seed", "1")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fly") / "cross"
    save_world(damaged("cross", 8), folder)
    done = pavetwin("fly", folder, *SHORT, "-o", folder.parent / "warm")
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_streets_are_compared_on_the_screen_and_in_a_file(world: Path, tmp_path: Path) -> None:
    policies = ("--policy", "baseline", "--policy", "skip")
    done = pavetwin("fly", world, *SHORT[:2], "--segments", "3", *policies, "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    rows = pl.read_parquet(tmp_path / "m" / "mission.parquet")
    streets = pl.read_csv(tmp_path / "m" / "streets.csv")
    assert streets["policy"].unique(maintain_order=True).to_list() == ["baseline", "skip"]
    sums = rows.group_by("policy", "street", maintain_order=True).agg(pl.col("defects", "confirmed", "area_m2").sum())
    assert (
        streets.select("policy", "street", "defects", "found").rows()
        == sums.select("policy", "street", "defects", "confirmed").rows()
    )
    assert (streets["area_m2"] - sums["area_m2"]).abs().max() < 0.1
    missed = streets.select(pl.sum_horizontal("hidden", "not_recognised", "other_missed"))
    assert (missed.to_series() == streets["defects"] - streets["found"]).all()
    for street, found in sums.filter(policy="skip").select("street", pl.col("confirmed") / pl.col("defects")).rows():
        (line,) = [line for line in done.stdout.splitlines() if line.startswith(street)]
        assert line.split()[-1] == f"{100 * found:.1f}"


def test_a_mission_leaves_its_files_and_says_where(world: Path, tmp_path: Path) -> None:
    done = pavetwin("fly", world, *SHORT, "--policy", "skip", "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / "m") in done.stdout
    assert "Preset default.\n" in done.stdout
    assert {path.name for path in (tmp_path / "m").iterdir()} == {
        "mission.parquet",
        "track.parquet",
        "detections.parquet",
        "captures.geojson",
        "streets.csv",
        "defects.gpkg",
        "defects.csv",
        "mission.yaml",
        "map.png",
    }
    rows = pl.read_parquet(tmp_path / "m" / "mission.parquet")
    assert rows.height == 2
    assert rows["policy"].unique().to_list() == ["skip"]
    features = json.loads((tmp_path / "m" / "captures.geojson").read_text())["features"]
    assert len(features) == rows["confirmed"].sum()
    lon, lat = features[0]["geometry"]["coordinates"]
    assert -180 <= lon <= 180
    assert -90 <= lat <= 90
    description = yaml.safe_load((tmp_path / "m" / "mission.yaml").read_text())
    assert description["totals"]["confirmed"] == len(features)
    assert description["settings"]["altitude_m"] == 10.0


def test_the_table_is_printed_before_the_map_is_drawn(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("no ink")

    monkeypatch.setattr("pavetwin.draw.mission_map.save_mission_map", fail)
    done = pavetwin("fly", world, *SHORT, "-o", tmp_path / "m")
    assert "'map.png' could not be drawn" in plain_refusal(done).replace(f"{tmp_path / 'm'}/", "")
    assert "of the surface seen" in done.stdout
    assert "Results in" not in done.stdout


def test_a_mission_without_a_map_loads_nothing_that_draws(world: Path, tmp_path: Path) -> None:
    policies = ["--policy", "hover", "--policy", "skip"]
    command = ["fly", str(world), *SHORT, "--no-map", *policies, "-o", str(tmp_path / "m")]
    script = f"""
import sys
sys.argv = {["pavetwin", *command]!r}
from pavetwin.cli import main
try:
    main()
finally:
    print(*sorted({{name.partition(".")[0] for name in sys.modules}}))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    *told, loaded = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    assert sorted({"matplotlib", "PIL", "wgpu", "fontTools"} & set(loaded.split())) == []
    assert not (tmp_path / "m" / "map.png").exists()
    folder = "mission.parquet, streets.csv, and a folder for each policy with streets.csv, defects.gpkg, "
    assert told[-1].startswith(f"Results in {tmp_path / 'm'}/: {folder}")


@pytest.mark.parametrize("seed", [3, pytest.param(0, marks=pytest.mark.slow)])
def test_the_same_command_twice_gives_the_same_bytes(world: Path, tmp_path: Path, seed: int) -> None:
    arguments = ("--density", "low", "--segments", "2", "--seed", seed, "--policy", "hover")
    for name, run in (("a", pavetwin), ("b", pavetwin_process)):
        assert run("fly", world, *arguments, "-o", tmp_path / name).returncode == 0
    assert digests(tmp_path / "a") == digests(tmp_path / "b")


@pytest.mark.slow
def test_the_policy_changes_neither_traffic_nor_defects_nor_order(world: Path, cache: Path, tmp_path: Path) -> None:
    before = digests(cache) | {"world": hashlib.sha256((world / "world.gpkg").read_bytes()).hexdigest()}
    done = pavetwin("fly", world, *SHORT, "--policy", "all", "-o", tmp_path / "all")
    assert done.returncode == 0, done.stderr
    after = digests(cache) | {"world": hashlib.sha256((world / "world.gpkg").read_bytes()).hexdigest()}
    assert before == after
    rows = pl.read_parquet(tmp_path / "all" / "mission.parquet")
    for name in ("segment", "defects", "length_m"):
        by_policy = [part.sort("order")[name].to_list() for _, part in rows.group_by("policy")]
        assert len(by_policy) == 4
        assert all(values == by_policy[0] for values in by_policy)
    assert (tmp_path / "all" / "comparison.png").is_file()
    alone = pavetwin("fly", world, *SHORT, "--policy", "micro", "-o", tmp_path / "alone")
    assert alone.returncode == 0
    assert digests(tmp_path / "alone") == digests(tmp_path / "all" / "micro")


def test_a_mission_is_replaced_but_nothing_else_is(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert pavetwin("fly", world, *SHORT, "-o", tmp_path / "m").returncode == 0
    assert pavetwin("fly", world, *SHORT, "-o", tmp_path / "m").returncode == 0
    kept = digests(tmp_path / "m")
    with monkeypatch.context() as refused:
        refused.delattr("pavetwin.mission.inputs.traffic_of")  # before any traffic is recorded
        line = plain_refusal(pavetwin("fly", world, *SHORT, "--altitude", "9", "-o", tmp_path / "m"))
        unnamed = plain_refusal(pavetwin("fly", world, *SHORT[2:], "-o", tmp_path / "m"))
    assert "holds another mission (other settings); choose another folder, or replace it (--force)" in line
    assert "holds another mission (other traffic);" in unnamed
    assert digests(tmp_path / "m") == kept
    assert pavetwin("fly", world, *SHORT, "--altitude", "9", "-o", tmp_path / "m", "--force").returncode == 0
    assert digests(tmp_path / "m") != kept
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("precious")
    assert "holds no mission" in plain_refusal(pavetwin("fly", world, *SHORT, "-o", tmp_path / "mine"))
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "precious"


def test_ones_own_policy_from_a_file(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.draw.mission_map.save_mission_map", lambda _, path: path.touch())  # takes longest
    monkeypatch.setattr("pavetwin.draw.mission_map.save_comparison_map", lambda _, path: path.touch())
    file = tmp_path / "restless.py"
    file.write_text(
        "from pavetwin.policies import GoOn, Policy\n"
        "class Restless(Policy):\n"
        "    def decide(self, snapshot):\n"
        "        return GoOn()\n"
    )
    mine = f"{file}:Restless"
    done = pavetwin("fly", world, *SHORT, "--policy", mine, "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    line = plain_refusal(pavetwin("fly", world, *SHORT, "--policy", "all", "--policy", mine, "-o", tmp_path / "m"))
    assert "holds another mission;" in line
    done = pavetwin("fly", world, *SHORT, "--policy", "all", "--policy", mine, "-o", tmp_path / "all")
    assert done.returncode == 0, done.stderr
    assert pl.read_parquet(tmp_path / "all" / "mission.parquet")["policy"].unique(maintain_order=True).to_list() == [
        *("baseline", "hover", "micro", "skip", "Restless")
    ]
    shutil.rmtree(tmp_path / "all")
    (tmp_path / "namesake").mkdir()
    shutil.copy(file, tmp_path / "namesake")
    other = f"{tmp_path / 'namesake' / 'restless.py'}:Restless"
    line = plain_refusal(pavetwin("fly", world, *SHORT, "--policy", mine, "--policy", other))
    assert "are both named 'Restless'; rename one of them" in line
    shutil.rmtree(tmp_path / "namesake")
    baseline = pavetwin("fly", world, *SHORT, "--policy", "baseline", "-o", tmp_path / "b")
    assert baseline.returncode == 0
    same = ("track.parquet", "captures.geojson")
    assert [digests(tmp_path / "m")[name] for name in same] == [digests(tmp_path / "b")[name] for name in same]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "m", "restless.py"]  # no __pycache__


@pytest.mark.slow
def test_another_mission_gets_another_folder_and_the_same_one_the_same(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pavetwin.draw.mission_map.save_mission_map", lambda _, path: path.touch())  # takes longest
    own = tmp_path / "cross"
    shutil.copytree(world, own)
    plain = "hover-low-1-10m-default-seed1"
    short = ("--density", "low", "--seed", "1")
    for options, count in (
        ((), 1),
        (("--set", "policy.max_wait_s=60"), 2),
        (("--set", "policy.max_wait_s=90"), 3),
        (("--set", "policy.max_wait_s=60"), 3),
        (("--segments", "2"), 4),
        (("--segment", "s0001"), 5),
        (("--defect-seed", "5"), 6),
        (("--segments", "8", "--altitude", "10"), 6),
        (("--policy", "hover", "--policy", "skip"), 7),
        (("--policy", "all"), 8),
    ):
        done = pavetwin("fly", own, *short, *options)
        assert done.returncode == 0, done.stderr
        names = {path.name for path in (own / "missions").iterdir()}
        assert len(names) == count, options
        assert plain in names
        assert all(name.partition("-")[2].startswith("low-1-10m-default-seed1") for name in names)


@pytest.mark.slow
def test_a_mission_is_flown_again_from_its_description_alone(world: Path, tmp_path: Path) -> None:
    first = ("--density", "low", "--segments", "3", "--order", "near", "--policy", "micro", "--altitude", "9")
    done = pavetwin("fly", world, *first, "--seed", "4", "--set", "policy.max_wait_s=33", "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    again = ("fly", "--again", tmp_path / "m" / "mission.yaml")
    done = pavetwin(*again)
    assert done.returncode == 0, done.stderr
    assert "The same as the first time." in done.stdout
    assert digests(tmp_path / "m-again") == digests(tmp_path / "m")
    done = pavetwin("fly", "--again", tmp_path / "m", "-o", tmp_path / "of-folder")
    assert "The same as the first time." in done.stdout
    done = pavetwin(*again, "--defect-seed", "7", "-o", tmp_path / "other")
    assert "Not the same mission as before" in done.stdout
    assert "--seed" in plain_refusal(pavetwin(*again, "--seed", "1"))
    save_world(built("cross", seed=2), tmp_path / "elsewhere")
    line = plain_refusal(pavetwin("fly", tmp_path / "elsewhere", *again[1:]))
    assert "inputs are not what they were" in line
    assert "the world 'cross'" in line
    text = (tmp_path / "m" / "mission.yaml").read_text()
    for name, words, damage in (
        ("torn", "unknown key 'sead' (did you mean 'seed'?)", text.replace("\nseed: 4", "\nsead: 4")),
        ("none", "not a mission.yaml", "- 1"),
        ("old", "format 3 or 4 or 5", text.replace("format: 5", "format: 2")),
        ("odd", "max_wait_s", text.replace("max_wait_s: 33", "max_wait_s: soon")),
        ("moved", "is not at", text.replace(str(world), str(tmp_path / "gone"))),
    ):
        (tmp_path / f"{name}.yaml").write_text(damage)
        assert words in plain_refusal(pavetwin("fly", "--again", tmp_path / f"{name}.yaml"))
    gone = tmp_path / "gone"
    assert plain_refusal(pavetwin("fly", "--again", gone)).startswith(f"Error: --again: there is no '{gone}'; name")
    assert "--again" in plain_refusal(pavetwin("fly"))


def test_a_mission_with_files_of_its_own_needs_nothing_else_and_names_what_changed(world: Path, tmp_path: Path) -> None:
    """Routes, another aircraft and a policy from a file: flown again from the description, then each is changed."""
    policy, routes, aircraft = (tmp_path / name for name in ("calm.py", "own.rou.xml", "sky.csv"))
    sensor, camera = tmp_path / "keen.py", tmp_path / "cam.yaml"
    (tmp_path / "thresholds.py").write_text("LEAST = 0.0\n")
    sensor.write_text(
        "from thresholds import LEAST\n"
        "from pavetwin.sensing import Detection, Sensor\n"
        "class Keen(Sensor):\n"
        "    def detect(self, frame):\n"
        "        return [Detection.of(each) for each in frame.sightings if each.visible_fraction > LEAST]\n"
    )
    camera.write_text("mine:\n  title: Mine\n  image_px: [1270, 950]\n  vertical_fov_deg: 60\n")
    policy.write_text(
        "from pavetwin.policies import GoOn, Policy\n"
        "class Calm(Policy):\n"
        "    def decide(self, snapshot):\n"
        "        return GoOn()\n"
    )
    edges = [segment.edges[0] for segment in load_world(world).segments]
    routes.write_text(
        f'<routes><trip id="a" depart="0" from="{edges[0]}" to="{edges[0]}"/>'
        f'<trip id="b" depart="1" from="{edges[1]}" to="{edges[1]}"/></routes>'
    )
    aircraft.write_text("aircraft,t_s,x_m,y_m,altitude_m\nother,0,900,900,10\nother,60,950,900,10\n")
    mine = ("--routes", routes, "--airspace", aircraft, "--policy", f"{policy}:Calm", "--segments", "1")
    eyes = ("--sensor", "keen.py:Keen", "--set", "camera.model=cam.yaml")  # relative to where one is
    done = pavetwin("fly", world, *mine, *eyes, "-o", tmp_path / "m", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    again = ("fly", "--again", tmp_path / "m" / "mission.yaml")
    done = pavetwin(*again)
    assert "The same as the first time." in done.stdout, done.stdout + done.stderr
    for path in (policy, routes, aircraft, sensor, camera, tmp_path / "thresholds.py"):
        before = path.read_text()
        path.write_text(before + "\n")
        line = plain_refusal(pavetwin(*again))
        assert f"'{path}' has changed" in line
        path.write_text(before)
    aircraft.unlink()
    policy.write_text(policy.read_text() + "# thought over\n")
    line = plain_refusal(pavetwin(*again))
    assert f"'{aircraft}' is gone" in line
    assert f"'{policy}' has changed" in line


def test_defects_that_changed_in_the_world_are_named(world: Path, tmp_path: Path) -> None:
    own = tmp_path / "cross"
    shutil.copytree(world, own)
    done = pavetwin("fly", own, *SHORT, "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    save_world(damaged("cross", 2), own, force=True)
    line = plain_refusal(pavetwin("fly", "--again", tmp_path / "m" / "mission.yaml"))
    assert "the world 'cross' has other defects than those that were looked for" in line


def test_two_worlds_that_differ_in_their_defects_alone_are_two(world: Path, tmp_path: Path) -> None:
    save_world(built("cross"), tmp_path / "bare")
    bare, full = (read_description(folder) for folder in (tmp_path / "bare", world))
    assert bare["content_hash"] == full["content_hash"], "traffic and flight domains are shared"
    assert bare["defects_hash"] != full["defects_hash"]
    assert pavetwin("fly", tmp_path / "bare", *SHORT, "-o", tmp_path / "m").returncode == 0
    line = plain_refusal(pavetwin("fly", world, "--again", tmp_path / "m" / "mission.yaml", "-o", tmp_path / "n"))
    assert "the world 'cross' has other defects than those that were looked for" in line
    assert not (tmp_path / "n").exists()


def test_other_results_of_the_same_mission_are_a_failure(world: Path, tmp_path: Path) -> None:
    assert pavetwin("fly", world, *SHORT, "-o", tmp_path / "m").returncode == 0
    path = tmp_path / "m" / "mission.yaml"
    values = yaml.safe_load(path.read_text())
    values["totals"]["confirmed"] += 1
    path.write_text(yaml.safe_dump(values))
    done = pavetwin("fly", "--again", path)
    assert done.returncode == 1, done.stderr
    assert "Not the same as the first time (confirmed)." in done.stdout


def test_policies_repeat_and_what_excludes_each_other_says_so(world: Path, tmp_path: Path) -> None:
    done = pavetwin("fly", world, *SHORT, "--policy", "hover", "--policy", "skip", "-o", tmp_path / "both")
    assert done.returncode == 0, done.stderr
    assert pl.read_parquet(tmp_path / "both" / "mission.parquet")["policy"].unique(maintain_order=True).to_list() == [
        "hover",
        "skip",
    ]
    line = plain_refusal(pavetwin("fly", world, "--density", "low", "--routes", "own.rou.xml"))
    assert "--density and --routes exclude each other" in line


@pytest.mark.slow
def test_missions_over_ones_own_demand_take_off_after_a_warm_up(world: Path, cache: Path, tmp_path: Path) -> None:
    edges = [segment.edges[0] for segment in load_world(world).segments]
    trips = "".join(
        f'<trip id="{number}" depart="{10 * number}" from="{edges[number % 2]}" to="{edges[number % 2]}"/>'
        for number in range(13)
    )
    (tmp_path / "own.rou.xml").write_text(f"<routes>{trips}</routes>")
    mine = ("fly", world, "--segments", "1", "--routes", tmp_path / "own.rou.xml")
    done = pavetwin(*mine, "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert "Take-off 120 s after the traffic begins, with " in done.stdout
    assert yaml.safe_load((tmp_path / "m" / "mission.yaml").read_text())["traffic"]["take_off_s"] == 120
    done = pavetwin(*mine, "--take-off", "0", "-o", tmp_path / "early")
    assert "Take-off 0 s after the traffic begins, with 1 vehicle and 0 pedestrians" in done.stdout
    line = plain_refusal(pavetwin(*mine, "--take-off", "1100", "-o", tmp_path / "late"))
    assert "--take-off 1100: nothing moves from then on" in line
    traffic = digests(cache)
    for command_of in (("fly", world), ("traffic", "record", world)):
        line = plain_refusal(pavetwin(*command_of, "--routes", HERE / "cross.osm"))
        assert "is an OpenStreetMap map, not a routes file of SUMO" in line
    assert digests(cache) == traffic


@pytest.mark.slow
def test_a_mission_takes_off_beside_the_road_or_where_it_is_told(world: Path, tmp_path: Path) -> None:
    loaded = load_world(world)
    middle = loaded.segments[0].centre_line.interpolate(0.5, normalized=True)
    lon, lat = loaded.georeference.to_wgs84((middle.x, middle.y))
    for name, options in (
        ("usual", ()),
        ("paper", ("--preset", "paper")),
        ("told", ("--base", f"{lat:.8f},{lon:.8f}")),
    ):
        done = pavetwin("fly", world, *SHORT, *options, "-o", tmp_path / name)
        assert done.returncode == 0, done.stderr
    starts = {}
    for name in ("usual", "paper", "told"):
        track = pl.read_parquet(tmp_path / name / "track.parquet")
        starts[name] = Point(track["x_m"][0], track["y_m"][0])
        base = yaml.safe_load((tmp_path / name / "mission.yaml").read_text())["base"]
        assert starts[name].distance(Point(base)) < 1e-6
        assert starts[name].distance(Point(track["x_m"][-1], track["y_m"][-1])) < 1e-6
    road = union_all([each.polygon for each in (*loaded.segments, *loaded.junctions)])
    assert road.distance(starts["usual"]) > 1.49
    assert starts["paper"].distance(loaded.base) < 1e-6
    assert starts["told"].distance(middle) < 0.02
    done = pavetwin("fly", "--again", tmp_path / "told" / "mission.yaml")
    assert "The same as the first time." in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--base", "here"), "--base here: expected LAT,LON in degrees"),
        (("--base", "5000,5000"), "--base 5000,5000: the nearest street is"),
        (("--take-off", "-3"), "--take-off -3: expected seconds from 0 up"),
        (("--policy", "hovr"), "did you mean 'hover'"),
        (("--policy", "no/such/file.py:Mine"), "no file"),
        (("--preset", "papper"), "did you mean 'paper'"),
        (("--set", "policy.max_wiat_s=3"), "did you mean 'max_wait_s'"),
        (("--set", "policy.max_wait_s=soon"), "max_wait_s"),
        (("--set", "nonsense"), "key=value"),
        (("--set", "energy.capacity_wh=0.2"), "Take off nearer to it (--base), leave it out, fly another --aircraft"),
        (("--set", "sensing.sensor=idael"), "did you mean 'ideal'"),
        (("--sensor", "keen.py"), "lacks the name of the class"),
        (("--set", "camera.model=phantom5"), "did you mean 'phantom4'"),
        (("--set", "pattern.kind=boustrofedon"), "did you mean 'boustrophedon'"),
        (("--altitude", "0"), "--altitude 0: the UAV flies at 5 m or higher"),
        (("--altitude", "-5"), "--altitude -5"),
        (("--altitude", "nan"), "--altitude nan"),
        (("--altitude", "inf"), "--altitude inf"),
        (("--altitude", "2"), "1 m clear of vehicles"),
        (("--altitude", "3000"), "120 m or lower"),
        (("--density", "hihg"), "did you mean 'high'"),
        (("--segments", "0"), "at least one"),
        (("--segments", "99"), "--segments all inspects them all"),
        (("--segments", "few"), "'all'"),
        (("--segment", "s9999"), "--segment: no segment or street 's9999'"),
        (("--segment", "Bogn"), "did you mean 'Bogen'"),
        (("--segment", "s1"), "did you mean 's0001'"),
        (("--segment", "12"), "did you mean 's0012'"),
        (("--segment", "s0001", "--segment", "s0002", "--segment", "s0001"), "--segment s0001: given more than once"),
        (("--order", "nearest"), "near"),
        (("--seed", "-1"), "seed"),
        (("--sgements", "3"), "--segments"),
        (("--altitude", "9", "--altitude=12"), "--altitude is given more than once"),
        (("--settings", "--set", "camera.model=phantom5"), "did you mean 'phantom4'"),
        (("--settings", "--set", "pattern.kind=boustro"), "did you mean 'boustrophedon'"),
        (("--settings", "--policy", "hovr"), "did you mean 'hover'"),
        (("--traffic", "nowhere.parquet"), "nowhere.parquet"),
        (("--airspace", "nowhere.csv"), "nowhere.csv"),
        (("--density", "low", "--again", "nowhere.yaml"), "--density"),
        (("--segment", "s0001", "--segments", "2"), "exclude each other"),
        (("--date", "2026-02-30"), "--date 2026-02-30: expected a date of the calendar"),
        (("--wind", "west"), "--wind west"),
        (("--parking", "1.5"), "--parking 1.5: expected a share of the places (0 to 1)"),
        (("--parking", "few"), "--parking few: expected a share of the places (0 to 1)"),
        (("--set", "energy.wind_mps=6"), "'wind_mps' has moved: give 'conditions.wind_mps'"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(world: Path, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    missions = world / "missions"
    density = () if {"--density", "--traffic"} & set(arguments) else ("--density", "low")
    line = plain_refusal(pavetwin("fly", world, *density, *arguments, cwd=tmp_path))
    assert words in line
    assert not missions.exists()
    assert not list(tmp_path.iterdir())


def test_date_time_clouds_and_wind_are_the_missions_conditions(world: Path) -> None:
    options = ("--date", "2026-06-21", "--time", "10:30", "--clouds", "0.4", "--wind", "5@90")
    settings = yaml.safe_load(pavetwin("fly", world, *options, "--settings").stdout)
    expected = {"date": "2026-06-21", "time": "10:30:00", "clouds": 0.4, "wind_mps": 5.0, "wind_from_deg": 90.0}
    assert settings["conditions"] == {**expected, "gust_factor": 1.0, "temperature_c": 20.0, "turbidity": 3.0}


@pytest.mark.parametrize(
    ("options", "enabled", "occupancy"),
    [
        ((), True, None),
        (("--parking", "by-time"), True, None),
        (("--preset", "paper"), False, None),
        (("--parking", "none"), False, None),
        (("--parking", "0.9"), True, 0.9),
        (("--preset", "paper", "--parking", "0.9"), True, 0.9),
    ],
)
def test_vehicles_park_unless_that_is_turned_off(
    world: Path, options: tuple[str, ...], enabled: bool, occupancy: float | None
) -> None:
    settings = yaml.safe_load(pavetwin("fly", world, *options, "--settings").stdout)
    assert settings["parking"] == {"enabled": enabled, "occupancy": occupancy}


def test_the_detector_needs_a_model_that_is_there(world: Path, tmp_path: Path) -> None:
    eyes = ("fly", world, *SHORT, "-o", tmp_path / "m", "--sensor", "detector")
    assert plain_refusal(pavetwin(*eyes, "--model", "none.onnx")).startswith(
        "Error: --model: There is no model 'none.onnx': name one that ships (mixed-3, synthetic-1"
    )
    other = pavetwin("fly", world, *SHORT, "-o", tmp_path / "m", "--model", drawn_detector.FILE)
    assert plain_refusal(other) == "Error: --model: the sensor 'recall' takes none; add --sensor detector."
    assert plain_refusal(pavetwin("fly", world, "--save-frames", "some")) == (
        "Error: --save-frames some: one of hits, all, none."
    )
    assert not (tmp_path / "m").exists()


@pytest.mark.needs_adapter
def test_frames_at_night_are_refused_before_anything_is_flown(world: Path, tmp_path: Path) -> None:
    line = plain_refusal(
        pavetwin("fly", world, *SHORT, "--time", "23:30", "--save-frames", "hits", "-o", tmp_path / "m")
    )
    assert line.startswith("Error: --time 23:30: on 2025-03-20 the sun is then")
    assert not (tmp_path / "m").exists()


def test_a_flight_writes_into_the_cache_and_not_into_the_world(world: Path, tmp_path: Path) -> None:
    own = tmp_path / "cross"
    shutil.copytree(world, own)
    before = digests(own)
    done = pavetwin("fly", own, *SHORT, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert digests(own) == before
    assert {path.suffix for path in (tmp_path / "cache").rglob("*.*")} == {".parquet", ".npz"}


def test_a_world_that_cannot_be_written_is_flown_all_the_same(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pavetwin.mission.naming.os.access", lambda _path, mode: mode != os.W_OK)
    done = pavetwin("fly", world, *SHORT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "missions" / "cross").iterdir()] == [
        f"hover-low-1-10m-default-seed1-{next((tmp_path / 'missions' / 'cross').iterdir()).name[-6:]}"
    ]
    assert not (world / "missions").exists()


def test_a_half_deleted_world_is_named(world: Path, tmp_path: Path) -> None:
    for missing in ("world.gpkg", "world.yaml", "roads.net.xml"):
        broken = tmp_path / missing.replace(".", "-")
        shutil.copytree(world, broken)
        (broken / missing).unlink()
        assert missing in plain_refusal(pavetwin("fly", broken, *SHORT))
    assert "nowhere" in plain_refusal(pavetwin("fly", tmp_path / "nowhere", *SHORT))


def test_a_map_in_place_of_a_world_says_how_to_build_one(tmp_path: Path) -> None:
    (tmp_path / "my town.osm").write_text("<osm/>")
    line = plain_refusal(pavetwin("fly", "my town.osm", cwd=tmp_path))
    assert "is a map, not a world yet" in line
    assert "`pavetwin world build 'my town.osm' --output 'my town'`" in line
    assert "`pavetwin world build SOURCE --output town`" in plain_refusal(pavetwin("fly", "town", cwd=tmp_path))


def test_a_network_that_was_cut_short_is_named_with_a_fix(world: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(world, broken)
    whole = (broken / "roads.net.xml").read_bytes()
    (broken / "roads.net.xml").write_bytes(whole[: len(whole) // 2])
    line = plain_refusal(pavetwin("fly", broken, *SHORT))
    assert str(broken / "roads.net.xml") in line
    assert "pavetwin world build" in line


def test_a_trace_of_another_world_is_refused(world: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    save_world(built("cross", seed=2), other)
    trace = next(cached(load_world(world), "traffic/low-1.parquet"))
    assert "world" in plain_refusal(pavetwin("fly", other, "--traffic", trace))


def test_a_folder_that_cannot_be_written_is_named(world: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    line = plain_refusal(pavetwin("fly", world, *SHORT, "-o", tmp_path / "file" / "m"))
    assert str(tmp_path / "file") in line
    assert "space" not in line
    line = plain_refusal(pavetwin("fly", world, *SHORT, "-o", "/proc/nothing/m"))
    assert "Cannot write '/proc/nothing/m': nothing can be made there. Choose another folder." in line
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_is_said_and_leaves_nothing(world: Path, tmp_path: Path) -> None:
    def no_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # else the kernel ends the process, unlike on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    line = plain_refusal(pavetwin_process("fly", world, *SHORT, "-o", tmp_path / "m", preexec_fn=no_room))
    assert "Cannot write" in line
    assert "Free some space" in line
    assert not list(tmp_path.iterdir())


def test_a_full_disk_while_traffic_is_recorded_is_said_and_leaves_nothing(world: Path, tmp_path: Path) -> None:
    def no_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))

    fly = ("fly", world, "--density", "high", "--segments", 1, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    line = plain_refusal(pavetwin_process(*fly, preexec_fn=no_room))
    assert "high-0.parquet" in line
    assert "Free some space" in line
    assert not (tmp_path / "m").exists()
    assert not list((tmp_path / "cache").rglob("*.parquet*"))
    assert is_over(lambda: not simulations(os.getpid()))


def test_a_damaged_recording_in_the_cache_is_made_again_and_said_once(world: Path, tmp_path: Path) -> None:
    fly = ("fly", world, *SHORT, "--cache", tmp_path / "cache", "--force", "-o", tmp_path / "m")
    assert pavetwin(*fly).returncode == 0
    (path,) = (tmp_path / "cache").rglob("*.parquet")
    whole, mission = path.read_bytes(), digests(tmp_path / "m")["mission.parquet"]
    path.write_bytes(whole[: len(whole) // 2])
    done = pavetwin(*fly)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("was damaged or of another version; it was recorded again") == 1
    assert path.read_bytes() == whole
    assert digests(tmp_path / "m")["mission.parquet"] == mission
    assert "recorded again" not in pavetwin(*fly).stdout


@pytest.mark.slow
def test_a_killed_mission_leaves_nothing_half_written_and_is_flown_again(world: Path, tmp_path: Path) -> None:
    """A mission is not resumed: what was recorded and flown is lost, and the same command gives it."""
    arguments = ("fly", world, "--density", "high", "--segments", "all", "--policy", "skip")
    whole = pavetwin(*arguments, "--cache", tmp_path / "kept", "-o", tmp_path / "whole")
    assert whole.returncode == 0, whole.stderr
    again = command(*arguments, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    process = subprocess.Popen(again, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert is_over(lambda: bool(simulations(process.pid)))
    ran = simulations(process.pid)
    process.kill()
    process.wait()
    assert is_over(lambda: all(is_gone(each) for each in ran))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "kept", "whole"]
    done = pavetwin(*arguments, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    for name in ("mission.parquet", "track.parquet"):
        assert digests(tmp_path / "m")[name] == digests(tmp_path / "whole")[name]


INTERRUPTED, TERMINATED = (signal.SIGINT, 130, "Interrupted"), (signal.SIGTERM, 143, "Terminated")


@pytest.mark.parametrize(
    ("moment", "number", "code", "said"),
    [
        ("recording", *INTERRUPTED),
        pytest.param("writing", *TERMINATED, marks=pytest.mark.slow),
        pytest.param("recording", *TERMINATED, marks=pytest.mark.slow),
        pytest.param("flying", *INTERRUPTED, marks=pytest.mark.slow),
        pytest.param("flying", *TERMINATED, marks=pytest.mark.slow),
        pytest.param("writing", *INTERRUPTED, marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_run_leaves_nothing_half_written(
    world: Path, tmp_path: Path, moment: str, number: signal.Signals, code: int, said: str
) -> None:
    target = tmp_path / "cross"
    shutil.copytree(world, target)
    cache = tmp_path / "cache"
    before = set(digests(target))
    arguments = command(
        "fly", target, "--density", "high", "--segments", "all", "--policy", "all", "-o", tmp_path / "m"
    )
    process = subprocess.Popen(
        [*arguments, "--cache", str(cache)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    has_come = {
        "recording": lambda: simulations(process.pid),
        "flying": lambda: list(cache.rglob("high-0.parquet")),
        "writing": lambda: (tmp_path / "m").exists(),
    }[moment]
    assert is_over(lambda: bool(has_come()))
    process.send_signal(number)
    _, words = process.communicate(timeout=60)
    assert process.returncode == code, words
    assert words.splitlines()[-1] == f"Error: {said}; nothing half-written was left behind."
    assert [path.name for path in tmp_path.iterdir() if path.name not in ("cache", "cross", "m")] == []
    for result in (tmp_path / "m").glob("*/"):  # missions that were whole by then
        assert {"mission.parquet", "track.parquet", "captures.geojson", "mission.yaml"} <= set(digests(result))
    assert not [name for name in digests(tmp_path) if Path(name).name.startswith(".")]
    assert set(digests(target)) == before


@pytest.mark.parametrize(("number", "code", "said"), [INTERRUPTED, TERMINATED])
def test_an_interruption_while_the_kernel_has_traffic_read_is_one(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int, said: str
) -> None:
    def interrupted(*_: object) -> None:
        signal.raise_signal(number)

    monkeypatch.setattr(part_table, "from_columns", interrupted)
    done = pavetwin("fly", world, *SHORT, "-o", tmp_path / "m")
    assert done.returncode == code, done.stderr
    assert without_progress(done.stderr) == [f"Error: {said}; nothing half-written was left behind."]
    assert not list(tmp_path.iterdir())


def test_an_error_without_words_tells_its_type(world: Path, tmp_path: Path) -> None:
    plugin = tmp_path / "silent.py"
    plugin.write_text("from pavetwin.errors import PaveTwinError\nraise PaveTwinError from TimeoutError()\n")
    line = plain_refusal(pavetwin("fly", world, *SHORT, "--plugin", plugin, "-o", tmp_path / "m"))
    assert line == "Error: TimeoutError, of which nothing more is known."
