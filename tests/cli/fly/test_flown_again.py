"""`pavetwin fly --again`: from its description a mission is the same, and what changed is named."""

import shutil
from pathlib import Path

import pytest
import yaml

from pavetwin.world.folder import read_description
from pavetwin.world.store import load_world, save_world
from scenes import built, damaged
from scenes.command_line import SHORT, pavetwin, plain_refusal
from scenes.folders import digests


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
    assert "inputs have changed" in line
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
        "from pavetwin.sensing import Detections, Sensor\n"
        "class Keen(Sensor):\n"
        "    def detect(self, frame):\n"
        "        return Detections.of_defects(s.defect for s in frame.sightings if s.visible_fraction > LEAST)\n"
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
    assert "the world 'cross' has other defects" in line


def test_two_worlds_that_differ_in_their_defects_alone_are_two(world: Path, tmp_path: Path) -> None:
    save_world(built("cross"), tmp_path / "bare")
    bare, full = (read_description(folder) for folder in (tmp_path / "bare", world))
    assert bare["content_hash"] == full["content_hash"], "traffic and flight domains are shared"
    assert bare["defects_hash"] != full["defects_hash"]
    assert pavetwin("fly", tmp_path / "bare", *SHORT, "-o", tmp_path / "m").returncode == 0
    line = plain_refusal(pavetwin("fly", world, "--again", tmp_path / "m" / "mission.yaml", "-o", tmp_path / "n"))
    assert "the world 'cross' has other defects" in line
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
