"""Options of a sensor: declared by it, set by `sensing.options`, kept in a mission's description, varied in a study."""

from pathlib import Path

import polars as pl
import pytest

from pavetwin.config import load_settings
from pavetwin.config.mission import SensingSettings
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Pool
from pavetwin.experiments.run import run
from pavetwin.mission.fly import fly
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.planning import plan_mission
from pavetwin.mission.saving import save_mission
from pavetwin.mission.spec import files_of_settings
from pavetwin.sensing import Detections, Frame, Ideal, Sensor, load_sensor
from pavetwin.world.store import load_world, save_world
from scenes import damaged

CHOOSY = """
from pavetwin.sensing import Detections, Sensor


class Choosy(Sensor):
    default_options = {"confidence": 0.5, "every": 1, "blind": False, "model": "a"}

    def detect(self, frame):
        if self.options["blind"]:
            return []
        chosen = [each for each in frame.sightings if each.defect.id % self.options["every"] == 0]
        return Detections.of_defects([sighting.defect for sighting in chosen], self.options["confidence"])
"""


@pytest.fixture
def choosy(tmp_path: Path) -> str:
    (tmp_path / "choosy.py").write_text(CHOOSY)
    return f"{tmp_path / 'choosy.py'}:Choosy"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("options") / "cross"
    save_world(damaged("cross", 8), folder)
    return folder


def sensor(name: str, *overrides: str) -> Sensor:
    return load_sensor(load_settings("default", [f"sensing.sensor={name}", *overrides]).sensing, 0)


def test_an_option_has_its_default_until_it_is_set(choosy: str) -> None:
    assert sensor(choosy).options == {"confidence": 0.5, "every": 1, "blind": False, "model": "a"}
    changed = sensor(choosy, "sensing.options={confidence: 1, every: 2}", "sensing.options.model=b")
    assert changed.options == {"confidence": 1.0, "every": 2, "blind": False, "model": "b"}
    assert type(changed.options["confidence"]) is float


@pytest.mark.parametrize(
    ("given", "reported"),
    [
        ("evry=2", "sensing.options: the sensor 'Choosy' has no option 'evry' (did you mean 'every'?); known are conf"),
        ("every=2.5", "sensing.options.every: the sensor 'Choosy' expects a whole number such as 1 (got 2.5)."),
        ("every=true", "sensing.options.every: the sensor 'Choosy' expects a whole number such as 1 (got True)."),
        (
            "confidence=high",
            "sensing.options.confidence: the sensor 'Choosy' expects a number such as 0.5 (got 'high')",
        ),
        ("blind=1", "sensing.options.blind: the sensor 'Choosy' expects true or false such as False (got 1)."),
        ("model=3", "sensing.options.model: the sensor 'Choosy' expects a text such as 'a' (got 3)."),
    ],
)
def test_an_option_that_does_not_fit_is_one_plain_line(choosy: str, given: str, reported: str) -> None:
    with pytest.raises(PaveTwinError) as caught:
        sensor(choosy, f"sensing.options.{given}")
    assert reported in str(caught.value)


def test_a_sensor_without_options_takes_none() -> None:
    with pytest.raises(PaveTwinError, match="the sensor 'ideal' has no option 'every'; it has none"):
        sensor("ideal", "sensing.options.every=2")

    class Renamed(Ideal):
        def detect(self, frame: Frame) -> Detections:
            return super().detect(frame)

    with pytest.raises(PaveTwinError, match="has no option 'every'"):
        Renamed(SensingSettings(options={"every": 2}), 0)


def test_a_file_that_an_option_names_belongs_to_the_mission(
    choosy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, kind = tmp_path / "model.onnx", tmp_path / "fast"
    model.write_bytes(b"weights")
    kind.write_bytes(b"no model")
    monkeypatch.chdir(tmp_path)
    settings = load_settings("default", [f"sensing.sensor={choosy}", "sensing.options.model=model.onnx"])
    assert settings.sensing.options == {"model": str(model)}
    files = {file.path: file for file in files_of_settings(settings)}
    assert files[str(model)].difference() is None
    model.write_bytes(b"other weights")
    assert files[str(model)].difference() == f"'{model}' has changed"
    plain = load_settings("default", [f"sensing.sensor={choosy}", "sensing.options.model=fast"])
    assert plain.sensing.options == {"model": "fast"}
    assert str(kind) not in {file.path for file in files_of_settings(plain)}


def test_a_mission_is_flown_again_with_its_options(choosy: str, world: Path, tmp_path: Path) -> None:
    settings = load_settings("default", [f"sensing.sensor={choosy}", "sensing.options.every=2"])
    result = fly(plan_mission(load_world(world), settings, density="low", segments=1, policy="baseline", seed=1))
    found = set(result.confirmed.defect.tolist())
    assert found
    assert all(defect is not None and defect % 2 == 0 for defect in found)
    save_mission(result, tmp_path / "m")
    former = MissionFolder(tmp_path / "m" / "mission.yaml")
    assert former.spec.settings.sensing.options == {"every": 2}
    assert former.differences(fly(former.spec)) == []


@pytest.mark.slow
def test_a_study_sweeps_an_option_and_gives_each_sensor_its_own(choosy: str, world: Path, tmp_path: Path) -> None:
    values = {
        "worlds": [str(world)],
        "densities": ["low"],
        "altitudes_m": [6],
        "policies": ["baseline"],
        "sensors": ["ideal", choosy],
        "sweep": {"sensing.options.every": [1, 3]},
        "set": {"sensing.options.confidence": 0.25},
        "replicates": 2,
        "seed": 4,
    }
    table = run(Design.parse(values, where="the design"), tmp_path / "study", Pool(2)).table
    assert (table["status"] == "flown").all(), table["reason"].to_list()
    every, confirmed = pl.col("sensing.options.every"), {}
    for value in (1, 3):
        confirmed[value] = table.filter(every == value, sensor=choosy)["confirmed"].sum()
    ideal = table.filter(sensor="ideal")
    assert ideal.height == 2, "it has no such option: flown once a replicate"
    assert ideal["sensing.options.every"].null_count() == 2
    assert 0 < confirmed[3] < confirmed[1] == ideal["confirmed"].sum()
    unknown = Design.parse(values | {"set": {"sensing.options.evry": 2}}, where="the design")
    with pytest.raises(
        PaveTwinError, match=r"^the design: sensing\.options: no sensor .* has an option 'evry' \(did you mean 'every'"
    ):
        run(unknown, tmp_path / "other", Pool(2))
