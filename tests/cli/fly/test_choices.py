"""What `pavetwin fly` lets choose, and how it refuses what is wrong."""

from pathlib import Path

import polars as pl
import pytest
import yaml
from shapely import Point, union_all

from pavetwin.world.store import load_world
from scenes import HERE, drawn_detector
from scenes.command_line import SHORT, pavetwin, plain_refusal
from scenes.folders import digests


def test_policies_repeat_and_exclusive_options_are_refused(world: Path, tmp_path: Path) -> None:
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
def test_a_mission_takes_off_next_to_the_road_or_from_its_base(world: Path, tmp_path: Path) -> None:
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
        (("--sensor", "keen.py"), "names no class"),
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
        (("--segments", "99"), "choose fewer, or all"),
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
    ],
)
def test_errors_take_one_line(world: Path, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    missions = world / "missions"
    density = () if {"--density", "--traffic"} & set(arguments) else ("--density", "low")
    line = plain_refusal(pavetwin("fly", world, *density, *arguments, cwd=tmp_path))
    assert words in line
    assert not missions.exists()
    assert not list(tmp_path.iterdir())


def test_the_detector_needs_a_model_that_is_there(world: Path, tmp_path: Path) -> None:
    eyes = ("fly", world, *SHORT, "-o", tmp_path / "m", "--sensor", "detector")
    assert plain_refusal(pavetwin(*eyes, "--model", "none.onnx")).startswith(
        "Error: --model: There is no model 'none.onnx': name one that ships (photographs, rendered"
    )
    other = pavetwin("fly", world, *SHORT, "-o", tmp_path / "m", "--model", drawn_detector.FILE)
    assert plain_refusal(other) == "Error: --model: the sensor 'recall' takes none; add --sensor detector."
    assert plain_refusal(pavetwin("fly", world, "--save-frames", "some")) == (
        "Error: --save-frames some: expected one of hits, all, none."
    )
    assert not (tmp_path / "m").exists()


@pytest.mark.needs_adapter
def test_frames_at_night_are_refused_before_anything_is_flown(world: Path, tmp_path: Path) -> None:
    line = plain_refusal(
        pavetwin("fly", world, *SHORT, "--time", "23:30", "--save-frames", "hits", "-o", tmp_path / "m")
    )
    assert line.startswith("Error: --time 23:30: on 2025-03-20 the sun is then")
    assert not (tmp_path / "m").exists()
