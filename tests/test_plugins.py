"""A user's own things from files: read once, checked, named when they clash, and known to settings and designs."""

from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import read_design
from pavetwin.plugins import load_plugins, plugin_hashes
from pavetwin.policies import POLICIES, load_policy
from pavetwin.sensing import SENSORS, load_sensor
from pavetwin.uav import CAMERAS, find_camera

MINE = """
    from pavetwin.policies import GoOn, Policy, policy
    from pavetwin.uav import CAMERAS, Camera

    CAMERAS.add("mine", Camera(title="Mine", image_px=(400, 300), vertical_fov_deg=50.0))

    @policy("calm")
    class Calm(Policy):
        def decide(self, snapshot):
            return GoOn()
"""
SHARP = """
    from pavetwin.sensing import Ideal

    class Sharp(Ideal):
        pass

    class Blind(Ideal):
        def detect(self, frame):
            return [999]
"""


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    yield
    for registry, name in ((POLICIES, "calm"), (CAMERAS, "mine"), (SENSORS, "sharp")):
        if name in registry.names():
            registry.restore(name, None)


def file(folder: Path, text: str, name: str = "mine.py") -> str:
    (folder / name).write_text(dedent(text), encoding="utf-8")
    return str(folder / name)


def test_settings_read_the_plugins_that_they_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file(tmp_path, MINE)
    monkeypatch.chdir(tmp_path)
    settings = load_settings("default", ["plugins=[mine.py]", "camera.model=mine"])
    assert settings.plugins == (str(tmp_path / "mine.py"),)
    assert find_camera(settings.camera.model).title == "Mine"
    assert load_policy("calm", settings.policy).name == "calm"
    assert set(plugin_hashes(settings.plugins)) == set(settings.plugins)


def test_plugins_of_a_design_are_relative_to_its_file(tmp_path: Path) -> None:
    file(tmp_path, MINE)
    (tmp_path / "design.yaml").write_text("worlds: [town]\npolicies: [calm]\nplugins: [mine.py]\n")
    assert read_design(tmp_path / "design.yaml").plugins == (str(tmp_path / "mine.py"),)


def test_two_plugins_of_one_name_are_one_plain_line(tmp_path: Path) -> None:
    first = file(tmp_path, MINE)
    second = file(tmp_path, MINE.replace("class Calm", "class Other").replace('"mine"', '"other"'), "other.py")
    load_plugins([first, first])
    with pytest.raises(PaveTwinError) as caught:
        load_plugins([second])
    assert str(caught.value) == (
        f"`plugins`: '{second}' cannot be used: a policy 'calm' is registered already, by '{first}'."
    )
    assert "other" not in CAMERAS.names(), "what it registered before is taken back"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (MINE.replace("return GoOn()", "return 3"), "the policy 'calm' breaks a rule: with"),
        (MINE + "\n    1 / 0\n", "fails when read: ZeroDivisionError"),
        (MINE.replace('"calm"', '"hover"'), "a policy 'hover' is registered already"),
    ],
)
def test_a_bad_plugin_registers_nothing(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(PaveTwinError, match=complaint) as caught:
        load_plugins([file(tmp_path, text)])
    assert "\n" not in str(caught.value)
    assert "mine" not in CAMERAS.names()
    assert "calm" not in POLICIES.names()


def test_a_plugin_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"`plugins`: there is no file '.*gone\.py'"):
        load_plugins([tmp_path / "gone.py"])


def test_a_sensor_goes_by_its_file_and_keeps_the_rules(tmp_path: Path) -> None:
    path = file(tmp_path, SHARP, "sharp.py")
    settings = load_settings("default", [f"sensing.sensor={path}:Sharp"])
    assert load_sensor(settings.sensing, 0).name == "Sharp"
    with pytest.raises(PaveTwinError, match=r"sensing\.sensor: '.*sharp\.py:Blind' breaks a rule: "):
        load_sensor(load_settings("default", [f"sensing.sensor={path}:Blind"]).sensing, 0)


def test_an_unknown_name_is_refused_with_a_hint_at_plugins() -> None:
    with pytest.raises(PaveTwinError, match="One of your own needs its file in `plugins`"):
        POLICIES.get("calm")


def test_declared_data_and_helpers_are_part_of_a_plugin(tmp_path: Path) -> None:
    file(tmp_path, "1.0", "weights.txt")
    file(tmp_path, "table", "table.csv")
    file(tmp_path, "not read", "other.txt")
    file(tmp_path, 'DATA_FILES = ["table.csv"]\n', "helper_with_data.py")
    mine = file(tmp_path, 'DATA_FILES = ["weights.txt"]\nimport helper_with_data\n')
    load_plugins([mine])
    before = plugin_hashes([mine])
    assert {Path(path).name for path in before} == {"mine.py", "helper_with_data.py", "weights.txt", "table.csv"}
    file(tmp_path, "2.00", "weights.txt")
    after = plugin_hashes([mine])
    assert {Path(path).name for path in before if before[path] != after[path]} == {"weights.txt"}


@pytest.mark.parametrize(
    ("declared", "complaint"),
    [
        ('["gone.onnx"]', r"DATA_FILES names '.*gone\.onnx', and there is no such file"),
        ('"model.onnx"', "DATA_FILES must be a list of file names"),
    ],
)
def test_declared_data_that_is_not_there_is_named(tmp_path: Path, declared: str, complaint: str) -> None:
    with pytest.raises(PaveTwinError, match=rf"`plugins`: '.*mine\.py': {complaint}"):
        load_plugins([file(tmp_path, f"{dedent(MINE)}\nDATA_FILES = {declared}\n")])
    assert "calm" not in POLICIES.names()
