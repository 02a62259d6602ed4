"""The adapter for Ultralytics, with a fake of the package, which is not installed."""

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.training.evaluation import ultralytics_models
from pavetwin.training.evaluation.comparison import ComparedModel, cells, processor, with_speeds
from pavetwin.training.evaluation.ultralytics_models import check_ultralytics, open_ultralytics

NAMES = {0: "pothole", 1: "dog", 2: "Single_Crack", 3: "car"}


class Rows(np.ndarray):  # type: ignore[type-arg]
    def numpy(self) -> np.ndarray:  # type: ignore[type-arg]
        return np.asarray(self)


class Network:
    """A fake network that returns fixed rows and records its calls."""

    asked: ClassVar[list[dict[str, Any]]] = []

    def __init__(self, given: str, task: str, verbose: bool) -> None:
        self.given, self.task, self.verbose = given, task, verbose
        if given.endswith("damaged.pt"):
            raise EOFError("Ran out of input")
        self.names = {0: "dog"} if given.endswith("dogs.pt") else NAMES
        sizes = [SimpleNamespace(numel=lambda: 750_000)]
        self.overrides = {"imgsz": 320}
        self.model = SimpleNamespace(parameters=lambda: sizes)

    def predict(self, pixels: np.ndarray, **how: Any) -> list[Any]:  # type: ignore[type-arg]
        Network.asked.append({"colour": pixels[0, 0].tolist(), **how})
        rows = [[2, 3, 12, 9, 0.9, 0], [2, 3, 12, 9, 0.8, 1], [5, 5, 8, 30, 0.5, 2], [4, 4, 4, 9, 0.4, 3]]
        return [SimpleNamespace(boxes=SimpleNamespace(data=np.array(rows).view(Rows)))]


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    package = ModuleType("ultralytics")
    package.__spec__ = ModuleSpec("ultralytics", None)
    package.YOLO = Network  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "ultralytics", package)
    for name in ultralytics_models._SILENT:
        monkeypatch.delenv(name, raising=False)
    Network.asked = []


@pytest.mark.usefixtures("installed")
def test_its_detections_are_those_of_the_five_classes(tmp_path: Path) -> None:
    """Colours are turned for it, a class of its own and a box without area are left out."""
    (tmp_path / "best.pt").touch()
    model = open_ultralytics(tmp_path / "best.pt", confidence=0.001, image_px=640)
    picture = np.zeros((40, 60, 3), dtype=np.uint8)
    picture[..., 0] = 200
    (found,) = model.detect([picture])
    assert [*found.class_name] == ["pothole", "single_crack"]
    assert found.box_px.tolist() == [[2, 3, 12, 9], [5, 5, 8, 30]]
    assert found.confidence.tolist() == pytest.approx([0.9, 0.5])
    assert found.size_px == (60, 40)
    (asked,) = Network.asked
    assert (asked["colour"], asked["conf"], asked["imgsz"], asked["device"]) == ([0, 0, 200], 0.001, 640, "cpu")
    assert model.size_mb == 3.0
    assert open_ultralytics(tmp_path / "best.pt", confidence=0.001, image_px=0).image_px == 320


@pytest.mark.usefixtures("installed")
def test_a_network_is_built_from_its_description_and_nothing_is_fetched() -> None:
    """A name such as yolo11n.pt would be downloaded."""
    model = open_ultralytics("yolo11n", confidence=0.25, image_px=640)
    assert (model.model.given, model.model.task) == ("yolo11n.yaml", "detect")
    from os import environ

    assert (environ["YOLO_OFFLINE"], environ["YOLO_AUTOINSTALL"]) == ("true", "false")


@pytest.mark.usefixtures("installed")
def test_weights_that_are_of_no_use_are_refused(tmp_path: Path) -> None:
    for name in ("damaged.pt", "dogs.pt"):
        (tmp_path / name).touch()
    with pytest.raises(PaveTwinError, match=r"damaged.pt' is damaged, or no weights of Ultralytics."):
        open_ultralytics(tmp_path / "damaged.pt", confidence=0.25, image_px=640)
    with pytest.raises(PaveTwinError, match=rf"dogs.pt' knows none of the classes {', '.join(CLASS_LABELS)}."):
        open_ultralytics(tmp_path / "dogs.pt", confidence=0.25, image_px=640)
    with pytest.raises(PaveTwinError, match=r"`weights`: there is no file '.*gone.pt'."):
        check_ultralytics(tmp_path / "gone.pt")


def test_speeds_are_relative_to_the_untrained_network_n() -> None:
    rows = [
        ComparedModel(name, None, None, None, None, 1.0, speed, None)
        for name, speed in (("n, untrained", 40.0), ("mine", 10.0))
    ]
    assert [row.speed for row in with_speeds(rows, "n, untrained")] == [1.0, 0.25]
    assert cells(with_speeds(rows, "n, untrained")[1])[6:8] == ("10.0", "0.25")
    assert [row.speed for row in with_speeds(rows[1:], "n, untrained")] == [None]
    assert len(processor()) > 2
