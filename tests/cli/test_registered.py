"""`pavetwin aircraft`, `policy`, `sensor` and plugins: registered and own things, by name and file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import polars as pl
import pytest
import yaml
from typer.main import get_group

from pavetwin import plugins
from pavetwin.cli import COMMANDS, app
from pavetwin.defects import DEFECT_CLASSES, DefectOptions, add_defects
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import read_design
from pavetwin.files import FORMAT
from pavetwin.mission.saving import DETECTION_COLUMNS, LOOKS
from pavetwin.policies import POLICIES
from pavetwin.sensing.fit.look_tables import GROUP, LOOK_SCHEMA, POSE_SCHEMA
from pavetwin.sensing.fitted_sensor import SensorModel
from pavetwin.uav import AIRCRAFT
from pavetwin.world.store import save_world
from scenes import built
from scenes.command_line import pavetwin, plain_refusal
from scenes.fitted import drawn_looks, stated


def test_the_list_has_every_aircraft_and_marks_times_of_the_model() -> None:
    """DJI states no hover of the Phantoms, and of the Matrice 350 no time with the P1."""
    text = pavetwin("aircraft", "list").stdout
    assert all(name in text for name in AIRCRAFT.names())
    assert all(profile.title in text for profile in AIRCRAFT.values())
    rows = {line.split()[0]: line.split() for line in text.splitlines() if line}
    assert rows["mavic3e"][-5:] == ["0.92", "45", "38", "12", "2.7"]
    marked = {name: [cell for cell in row if cell.startswith("~")] for name, row in rows.items()}
    assert marked["phantom4pro"] == ["~27"]
    assert len(marked["matrice350"]) == 2
    assert marked["mavic3e"] == marked["mavic2pro"] == marked["matrice4e"] == []


def test_an_aircraft_is_shown_with_its_sources_and_the_figures_of_the_model(tmp_path: Path) -> None:
    text = pavetwin("aircraft", "show", "phantom4pro").stdout
    stated_figures, modelled = text.split("# Figures of the model")
    assert "DJI Phantom 4 Pro specifications" in stated_figures
    assert "flight_time_min: 30" in stated_figures
    assert "hover: 27 min (predicted" in modelled
    assert "assumed: blade tips at 120 m/s" in modelled
    assert text.split()[-3:] == ["20", "432", "42.0"]
    assert "hover:" not in pavetwin("aircraft", "show", "mavic3e").stdout
    plain = (Path(__file__).parents[2] / "src/pavetwin/uav/aircraft.yaml").read_text(encoding="utf-8")
    (tmp_path / "own.yaml").write_text(plain.replace("  tilt_deg: 42\n", ""), encoding="utf-8")
    assert "0.03 of the rotors' discs, assumed" in pavetwin("aircraft", "show", f"{tmp_path}/own.yaml:phantom4").stdout


def test_an_unknown_aircraft_is_one_plain_line_with_the_nearest() -> None:
    assert "did you mean 'mavic3e'?" in plain_refusal(pavetwin("aircraft", "show", "mavic3"))
    line = plain_refusal(pavetwin("fly", "--settings", "--aircraft", "phantom4prp"))
    assert line.startswith("Error: --aircraft: no aircraft 'phantom4prp' (did you mean 'phantom4pro'?)")


def test_fly_takes_an_aircraft_by_name_and_refuses_wind_above_its_limit(tmp_path: Path) -> None:
    assert "aircraft: phantom4\n" in pavetwin("fly", "--settings", "--aircraft", "phantom4").stdout
    windy = ("fly", "--settings", "--aircraft", "phantom4", "--wind")
    assert "above the 10 m/s that the DJI Phantom 4 is rated for" in plain_refusal(pavetwin(*windy, "10.5"))
    assert plain_refusal(pavetwin(*windy, "10.5")).startswith("Error: --wind: a wind of 10.5 m/s is above")
    assert pavetwin(*windy, "10").returncode == 0
    (tmp_path / "own.yaml").write_text("mine: {mass_kg: 1}", encoding="utf-8")
    line = plain_refusal(pavetwin("fly", "--settings", "--aircraft", tmp_path / "own.yaml"))
    assert "own.yaml, aircraft 'mine': title: it must be given" in line


def test_what_is_shown_is_a_file_of_the_same_aircraft(tmp_path: Path) -> None:
    printed = pavetwin("aircraft", "show", "matrice350").stdout
    own = tmp_path / "own.yaml"
    own.write_text(printed, encoding="utf-8")
    assert pavetwin("aircraft", "show", f"{own}:matrice350").stdout == printed


CALM = """
from pavetwin.policies import GoOn, Policy, policy
@policy("calm")
class Calm(Policy):
    def decide(self, snapshot):
        return GoOn()
"""
RUTTING = Path(__file__).resolve().parents[2] / "examples" / "rutting.py"


def leaves(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield path, command
    else:
        for name, each in inner.items():
            yield from leaves(each, f"{path} {name}")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_plugins(name: str) -> None:
    for path, command in leaves(get_group(app).get_command(None, name), name):
        flags = [flag for parameter in command.params for flag in parameter.opts]
        assert flags.count("--plugin") == 1, path


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As in a process that was given no plugin, before and after the test."""
    monkeypatch.setattr(plugins, "_loaded", {})
    yield
    DEFECT_CLASSES.restore("rutting", None)


@pytest.mark.slow
@pytest.mark.usefixtures("forgotten")
def test_a_class_of_ones_own_from_the_command_line(tmp_path: Path) -> None:
    plugins.load_plugins([RUTTING])
    options = DefectOptions(population="paper", per_segment=3, mix={"rutting": 1.0})
    save_world(add_defects(built("cross"), options), tmp_path / "rutted")
    DEFECT_CLASSES.restore("rutting", None)
    plugins._loaded.clear()
    assert "rutting" in pavetwin("world", "info", tmp_path / "rutted").stdout, "looking at it needs no plugin"
    segment = built("cross").world.segments[0].id
    export = ("world", "export", tmp_path / "rutted", tmp_path / "r.glb", "--segment", segment)
    assert "needs its file in --plugin" in plain_refusal(pavetwin(*export))
    assert "there is no file" in plain_refusal(pavetwin("world", "info", tmp_path / "rutted", "--plugin", "nosuch.py"))
    fly = ("fly", tmp_path / "rutted", "--density", "low", "--segments", "1", "--plugin", RUTTING, "-o", tmp_path / "m")
    done = pavetwin(*fly)
    assert done.returncode == 0, done.stderr
    table = pl.read_csv(tmp_path / "m" / "defects.csv")
    assert table["class"].unique().to_list() == ["rutting"]
    assert table["length_m"].is_between(2.0, 6.2).all(), "its extent, as it has no cracks"
    assert table["width_m"].is_between(1.7, 2.6).all()
    assert "rutting" in DEFECT_CLASSES.names()


def test_a_design_names_the_plugins_that_it_was_written_with(tmp_path: Path) -> None:
    done = pavetwin("experiment", "init", tmp_path / "d.yaml", "--plugin", RUTTING)
    assert done.returncode == 0, done.stderr
    assert read_design(tmp_path / "d.yaml").plugins == (str(RUTTING),)
    (tmp_path / "mine.py").write_text(CALM)
    (tmp_path / "studies").mkdir()
    pavetwin("experiment", "init", "studies/m.yaml", "--plugin", "mine.py", cwd=tmp_path)
    POLICIES.restore("calm", None)
    text = (tmp_path / "studies" / "m.yaml").read_text()
    assert 'plugins: ["../mine.py"]' in text
    assert "policies: [baseline, hover, micro, skip, calm] " in text


def test_a_mix_of_classes_is_placed(tmp_path: Path) -> None:
    build = ("world", "build", "--generate", "grid", "--defects-per-segment", "2", "-o", tmp_path / "w")
    assert "did you mean 'pothole'" in plain_refusal(pavetwin(*build, "--defect-mix", "pothol=1"))
    assert "as in --defect-mix pothole=2" in plain_refusal(pavetwin(*build, "--defect-mix", "pothole"))
    options = DefectOptions(per_segment=2, mix={"pothole": 2.0})
    with patch("pavetwin.defects.placement.add_defects", side_effect=PaveTwinError("enough")) as added:
        pavetwin(*build, "--defect-mix", "pothole=2")
    assert added.call_args.args[1] == options


@pytest.mark.usefixtures("forgotten")
def test_what_a_plugin_registers_is_listed(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from pavetwin.sensing import Detections, Sensor, sensor\n"
        "@sensor('blind_one')\n"
        "class Blind(Sensor):\n"
        '    """Finds nothing."""\n'
        "    def detect(self, frame):\n"
        "        return Detections.of_defects([])\n"
    )
    from pavetwin.sensing import SENSORS

    done = pavetwin("sensor", "list", "--plugin", file)
    SENSORS.restore("blind_one", None)
    assert "blind_one: Finds nothing." in done.stdout


def test_a_check_lists_every_broken_rule_of_a_policy(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from pavetwin.policies import Policy\n"
        "class Vague(Policy):\n"
        "    def decide(self, snapshot):\n"
        "        return 3\n"
    )
    printed = plain_refusal(pavetwin("policy", "check", f"{file}:Vague"))
    assert "more; --verbose lists them)" in printed
    more = int(printed.rpartition("(and ")[2].split()[0])
    listed = pavetwin("policy", "check", f"{file}:Vague", "--verbose")
    assert listed.returncode == 2
    assert len(listed.stdout.splitlines()) == more + 1


def mission(folder: Path, seed: int, sha256: str = stated().detector.sha256) -> Path:
    """A folder of `pavetwin fly --sensor detector`, as far as a fit reads it; each defect is looked at thrice."""
    looks = drawn_looks(stated(spread=1.5, alarms_per_m2=0), 80, 3, seed).looks
    count = looks.height
    table = looks.with_columns(
        pl.int_range(count).alias("capture"),
        pl.lit(1280).alias("image_px"),
        pl.lit(100.0).alias("area_m2"),
        pl.col(GROUP).str.split(" ").list.last().cast(pl.Int64).alias("defect"),
        *(pl.int_range(count).cast(pl.Float64).alias(name) for name in POSE_SCHEMA),
    ).select(*LOOK_SCHEMA, *POSE_SCHEMA)
    folder.mkdir(parents=True)
    table.write_parquet(folder / LOOKS)
    pl.DataFrame(schema=dict(DETECTION_COLUMNS)).write_parquet(folder / "detections.parquet")
    content = {
        "format": FORMAT,
        "totals": {},
        **dict.fromkeys(("traffic", "aircraft", "seed", "parking_seed", "parking_mix")),
        "world": {"content_hash": "w"},
        "defects": {"content_hash": f"d{seed}"},
        "plugins": [{"path": "/models/model.onnx", "sha256": sha256}],
        "settings": {"sensing": {"sensor": "detector", "options": {"model": "/models/model.onnx"}}},
    }
    (folder / "mission.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder


def test_a_sensor_is_fitted_to_missions_and_compared_with_others(tmp_path: Path) -> None:
    mission(tmp_path / "missions" / "a" / "hover", 1)
    mission(tmp_path / "missions" / "b" / "hover", 2)
    other = mission(tmp_path / "other", 3)
    file = tmp_path / "sensor.json"
    done = pavetwin("sensor", "fit", tmp_path / "missions", "--check", other, "-o", file)
    assert done.returncode == 0, done.stderr
    assert "Fitted to 480 views of 160 defects, 160 of them with several, in 480 images" in done.stdout
    assert "in views that the fit does not use" in done.stdout
    model = SensorModel.read(file)
    assert 0.3 < model.correlation < 0.9
    assert model.detector.image_px == 1280
    assert file.with_suffix(".png").stat().st_size > 5000
    assert "exists; choose another name, or add --force" in plain_refusal(pavetwin("sensor", "fit", other, "-o", file))


def test_inputs_that_cannot_be_fitted_are_refused_in_one_line(tmp_path: Path) -> None:
    one = mission(tmp_path / "one", 1)
    another = mission(tmp_path / "another", 2, sha256="f" * 64)
    (tmp_path / "empty").mkdir()
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "capture.yaml").write_text("world: {}", encoding="utf-8")
    out = ("-o", tmp_path / "s.json")
    reported = {
        ("sensor", "fit", one): "Missing option '--output'",
        ("sensor", "fit", one, "-o", tmp_path / "s.txt"): "the file is JSON; give a name such as s.json",
        ("sensor", "fit", tmp_path / "none", *out): "There is no folder",
        ("sensor", "fit", tmp_path / "empty", *out): "holds no mission.yaml and no capture.yaml",
        ("sensor", "fit", tmp_path / "set", *out, "--model", "none-1"): "--model: There is no model 'none-1'",
        ("sensor", "fit", one, another, *out): "were searched by different detectors",
        ("sensor", "fit", one, "--check", another, *out): "'another' was searched by another detector",
    }
    for typed, words in reported.items():
        assert words in plain_refusal(pavetwin(*typed))
    assert not (tmp_path / "s.json").exists()


@pytest.mark.parametrize("name", ["none.json", "none.onnx", "none-1"])
def test_a_missing_file_is_refused_before_flying(name: str) -> None:
    line = plain_refusal(pavetwin("fly", "--sensor", "calibrated", "--model", name, "--settings"))
    kind = {"none.json": "file", "none.onnx": "model", "none-1": "fitted sensor"}[name]
    assert f"here is no {kind} '{name}'" in line
    assert ("pavetwin sensor fit" in line) == (name != "none.onnx")


def test_the_fitted_sensor_that_ships_is_named_as_its_detector() -> None:
    named = pavetwin("fly", "--sensor", "calibrated", "--model", "rendered", "--settings")
    assert named.returncode == 0, named.stderr
    assert "fitted: rendered" in named.stdout
    other = pavetwin("fly", "--sensor", "detector", "--model", "rendered", "--settings")
    assert "model: rendered" in other.stdout
    assert "fitted" not in other.stdout


def test_missions_that_cannot_be_used_are_named_and_the_rest_is_fitted_to(tmp_path: Path) -> None:
    """One of another sensor, and one whose looks are gone."""
    flown = tmp_path / "missions"
    for seed, name in enumerate(("a", "b", "recall", "gone"), 1):
        mission(flown / name, seed)
    file = flown / "recall" / "mission.yaml"
    settings = {"settings": {"sensing": {"sensor": "recall"}}}
    file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | settings))
    (flown / "gone" / LOOKS).unlink()
    done = pavetwin("sensor", "fit", flown, "-o", tmp_path / "sensor.json")
    assert done.returncode == 0, done.stderr
    gone, recall = (line for line in done.stdout.splitlines() if line.startswith("Left out: "))
    assert f"'{flown / 'gone' / LOOKS}' is missing" in gone
    assert "the sensor is recall" in recall
    assert SensorModel.read(tmp_path / "sensor.json").fitted_to.sources == ("a", "b")
    alone = pavetwin("sensor", "fit", flown / "recall", flown / "gone", "-o", tmp_path / "none.json")
    assert "the sensor is recall" in plain_refusal(alone)
    assert "None of 2 missions can be used." in plain_refusal(alone)
