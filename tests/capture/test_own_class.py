"""A defect class from a user's file: placed, drawn, labelled, captured by two processes, and flown in a study."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from pavetwin import plugins
from pavetwin.capture.record import count
from pavetwin.capture.run import capture
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.sheets import save_sheet
from pavetwin.defects import DEFECT_CLASSES, DefectOptions, add_defects, heightfield_of, measure
from pavetwin.draw.world_map import legend
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Pool
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store
from pavetwin.world.store import load_record, load_world, save_world
from scenes import built
from scenes.painter import Painter

RUTTING = Path(__file__).resolve().parents[2] / "examples" / "rutting.py"
UAV = CaptureSettings(
    platforms=("uav",), images=12, altitudes_m=(10.0,), seed=3, size_px=(320, 320), plugins=(str(RUTTING),), empty=0.0
)
CLASSES = ["Single Crack", "Crocodile Crack", "Pothole", "Person", "Car", "Rutting"]


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The class is known in this process, as after a command's `--plugin`, and unknown again afterwards."""
    monkeypatch.setattr(plugins, "_loaded", {})
    plugins.load_plugins([RUTTING])
    yield
    if "rutting" in DEFECT_CLASSES.names():
        DEFECT_CLASSES.restore("rutting", None)


@pytest.fixture
def world(known: None, tmp_path: Path) -> Path:  # noqa: ARG001 - a fixture
    mix = {"rutting": 2.0, "pothole": 1.0}
    save_world(
        add_defects(built("cross"), DefectOptions(population="paper", per_segment=5, mix=mix)), tmp_path / "rutted"
    )
    return tmp_path / "rutted"


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a process that was given no plugin."""
    DEFECT_CLASSES.restore("rutting", None)
    monkeypatch.setattr(plugins, "_loaded", {})


def test_ruts_lie_in_the_wheel_paths_and_are_on_the_map(world: Path) -> None:
    loaded = load_world(world)
    ruts = [defect for defect in loaded.defects if defect.kind == "rutting"]
    assert len(ruts) > 5
    shape = heightfield_of(ruts[0])
    assert measure(shape).depth_m == pytest.approx(ruts[0].depth_m, abs=1e-5)
    deepest = np.argmin(shape.height_m[:, shape.shape[1] // 2 :].mean(axis=1))
    assert 0.65 < abs(shape.origin_m[1] + shape.cell_m * deepest) < 0.9, "half a track from the lane's middle"
    assert ruts[0].polygon.minimum_rotated_rectangle.length > 2.0
    assert "rutting" in [entry.label for entry in legend(loaded)]


@pytest.mark.usefixtures("known")
def test_the_usual_mix_of_a_world_with_plugins_is_written_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that nobody who lacks the plugin places other defects without noticing."""
    save_world(add_defects(built("cross"), DefectOptions(population="paper", per_segment=2)), tmp_path / "mixed")
    assert set(load_record(tmp_path / "mixed").defects["mix"]) == {kind.name for kind in DEFECT_CLASSES.values()}
    forget(monkeypatch)
    with pytest.raises(PaveTwinError, match=r"`defects`: no defect class 'rutting'.*needs its file in `plugins`"):
        add_defects(built("cross"), DefectOptions(mix={"rutting": 1.0}))


@pytest.mark.slow
def test_two_processes_capture_label_and_count_it(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alone, together = tmp_path / "alone", tmp_path / "together"
    capture(world, UAV, alone, frame_source_factory=Painter)
    captured = capture(world, UAV, together, frame_source_factory=Painter, jobs=2)
    labels = {path.name: path.read_text() for path in together.glob("labels/*/*.txt")}
    assert labels == {path.name: path.read_text() for path in alone.glob("labels/*/*.txt")}
    numbers = [int(line.split()[0]) for text in labels.values() for line in text.splitlines()]
    ruts = numbers.count(5)
    assert ruts > 3
    assert list(yaml.safe_load((together / "data.yaml").read_text())["names"].values()) == CLASSES
    found = [json.loads(path.read_text()) for path in together.glob("annotations/*.json")]
    number = next(each["id"] for each in found[0]["categories"] if each["name"] == "Rutting")
    coco = [each for file in found for each in file["annotations"] if each["category_id"] == number]
    assert sum(not each["iscrowd"] for each in coco) == ruts
    assert sum(path.read_text().count("<name>Rutting</name>") for path in together.glob("voc/Annotations/*")) == len(
        coco
    )
    forget(monkeypatch)  # looking at a dataset needs no plugin
    statistics = count(together)
    assert sum(statistics.labelled["Rutting", split] for split in statistics.images) == ruts
    assert statistics.as_dict() == captured.statistics.as_dict()
    assert save_sheet(together, tmp_path / "sheet.png", count=4) == 4


def test_another_plugin_is_another_dataset(world: Path, tmp_path: Path) -> None:
    own = tmp_path / "rutting.py"
    own.write_text(RUTTING.read_text())
    few = UAV.model_copy(update={"images": 2, "plugins": (str(own),)})
    DEFECT_CLASSES.restore("rutting", None)
    capture(world, few, tmp_path / "dataset", frame_source_factory=Painter)
    own.write_text(RUTTING.read_text() + "# another\n")
    with pytest.raises(PaveTwinError, match=r"begun with another content of rutting\.py; give the former file"):
        capture(world, few, tmp_path / "dataset", frame_source_factory=Painter)


def test_a_class_whose_plugin_is_missing_is_named_before_anything_is_baked(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forget(monkeypatch)
    said: list[str] = []
    with pytest.raises(PaveTwinError, match=r"`defects`: no defect class 'rutting'.*needs its file in `plugins`"):
        capture(
            world,
            UAV.model_copy(update={"plugins": ()}),
            tmp_path / "dataset",
            frame_source_factory=Painter,
            on_progress=lambda _, what: said.append(what),
        )
    assert said == ["Loading the world"]


@pytest.mark.slow
def test_a_study_flies_over_it_in_two_processes(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forget(monkeypatch)
    values = {
        "worlds": [str(world)],
        "densities": ["low"],
        "altitudes_m": [10],
        "policies": ["baseline"],
        "sensors": ["ideal"],
        "presets": ["default"],
        "replicates": 2,
        "defects": {"per_segment": 5, "mix": {"rutting": 1.0}},
        "plugins": [str(RUTTING)],
    }
    run(Design.parse(values, where="the design"), tmp_path / "study", Pool(2))
    table = Store(tmp_path / "study").table()
    assert (table["status"] == "flown").all(), table["reason"].to_list()
    assert table["defects"].min() > 0
    assert table["confirmed"].sum() > 0
    assert str(RUTTING) in Store(tmp_path / "study").description()["files"]


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_ruts_are_drawn(world: Path, tmp_path: Path) -> None:
    """By the renderer, and labelled: enough images that some aim at a rut."""
    from pavetwin.capture.scene_renderer import SceneFrameSource

    few = UAV.model_copy(update={"images": 6})
    capture(world, few, tmp_path / "drawn", frame_source_factory=SceneFrameSource)
    statistics = count(tmp_path / "drawn")
    assert sum(statistics.labelled["Rutting", split] for split in statistics.images) > 0
