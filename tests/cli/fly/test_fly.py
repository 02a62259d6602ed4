"""`pavetwin fly` as a user types it: its files, their bytes, and its output."""

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest
import yaml

from scenes.command_line import SHORT, pavetwin, pavetwin_process, plain_refusal
from scenes.folders import digests


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


def test_a_mission_writes_its_files_and_prints_their_folder(world: Path, tmp_path: Path) -> None:
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
    *reported, loaded = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    assert sorted({"matplotlib", "PIL", "wgpu", "fontTools"} & set(loaded.split())) == []
    assert not (tmp_path / "m" / "map.png").exists()
    folder = "mission.parquet, streets.csv, and a folder for each policy with streets.csv, defects.gpkg, "
    assert reported[-1].startswith(f"Results in {tmp_path / 'm'}/: {folder}")


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
