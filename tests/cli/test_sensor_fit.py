"""`pavetwin sensor fit` as typed, and missions with what it writes."""

from pathlib import Path

import polars as pl
import pytest
import yaml

from pavetwin.files import FORMAT
from pavetwin.mission.saving import DETECTION_COLUMNS, LOOKS
from pavetwin.sensing.fit.tables import GROUP, LOOK_SCHEMA, POSE_SCHEMA
from pavetwin.sensing.fitted_sensor import SensorModel
from scenes.command_line import pavetwin, plain_refusal
from scenes.fitted import drawn_looks, stated


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


def test_what_cannot_be_fitted_is_one_plain_line(tmp_path: Path) -> None:
    one = mission(tmp_path / "one", 1)
    another = mission(tmp_path / "another", 2, sha256="f" * 64)
    (tmp_path / "empty").mkdir()
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "capture.yaml").write_text("world: {}", encoding="utf-8")
    out = ("-o", tmp_path / "s.json")
    told = {
        ("sensor", "fit", one): "Missing option '--output'",
        ("sensor", "fit", one, "-o", tmp_path / "s.txt"): "the file is JSON; give a name such as s.json",
        ("sensor", "fit", tmp_path / "none", *out): "There is no folder",
        ("sensor", "fit", tmp_path / "empty", *out): "holds no mission.yaml and no capture.yaml",
        ("sensor", "fit", tmp_path / "set", *out, "--model", "none-1"): "--model: There is no model 'none-1'",
        ("sensor", "fit", one, another, *out): "were searched by different detectors",
        ("sensor", "fit", one, "--check", another, *out): "'another' was searched by another detector",
    }
    for typed, words in told.items():
        assert words in plain_refusal(pavetwin(*typed))
    assert not (tmp_path / "s.json").exists()


@pytest.mark.parametrize("name", ["none.json", "none.onnx", "none-1"])
def test_a_file_that_is_not_there_is_told_before_flying(name: str) -> None:
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
