"""`python -m benchmarks.training`: as many views for every variant, its tables, and nothing trained twice."""

import json
from pathlib import Path

import pytest
import torch
from benchmarks import learning, training
from benchmarks.measure import Size
from benchmarks.training import GROUPS, ORDERS, PHOTOGRAPHS, PLAIN, main, sized

from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.trainer import machine
from pavetwin.training.trainer.machine import has_half
from pavetwin.training.trainer.options import TrainingOptions
from pavetwin.training.trainer.schedule import phases_of
from scenes.drawn_roads import drawn_roads

VIEWS = 60

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Synthetic images and photographs."""
    path = tmp_path_factory.mktemp("data")
    town = drawn_roads(path / "town", {"train": 16, "val": 3, "test": 3}, synthetic=True)
    return town, drawn_roads(path / "photographs", {"train": 9, "val": 2, "test": 3}, seed=9)


@pytest.mark.parametrize("order", ["real", "synthetic", "mixed", "real-synthetic", "synthetic-real"])
def test_every_order_sees_as_many_views(folders: tuple[Path, Path], order: str) -> None:
    town, photographs = (read_examples([each]) for each in folders)
    options = TrainingOptions(order=order, image_px=64, classifier_epochs=0, seed=1)
    chosen = {"real": photographs, "synthetic": town}.get(order, [*town, *photographs])
    sets, fitted = sized(chosen, VIEWS, options)
    members = [(data, each) for data in sets for each in data.examples if each.split == "train"]
    seen = sum(phase.epochs * (phase.main + phase.drawn) for phase in phases_of(members, fitted))
    assert abs(seen - VIEWS) <= 3 * fitted.epochs
    assert any(each.split == "val" for data in sets for each in data.examples)


def test_the_tables_compare_with_the_first_of_a_group_and_runs_are_kept(
    folders: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tiny = {"width": 0.03, "depth": 0.01, "batch": 4, "mosaic_off": 0, "warmup_epochs": 0.1, "classifier_epochs": 0}
    monkeypatch.setattr(training, "RECIPE", {**tiny, "native": True, "image_px": 64})
    town, photographs = folders
    words = [str(town), "--photographs", str(photographs), "-o", str(tmp_path), "--seeds", "2", "--views", "24"]
    words += ["--image", "64", "--only", "ReLU", "synthetic, then photographs"]
    assert main(words) == 0
    printed = capsys.readouterr().out
    tables = [part.splitlines() for part in printed.strip().split("\n\n")[1::2]]
    assert [row.split(" | ")[0][2:] for row in tables[0][2:]] == [PLAIN, "ReLU"]
    assert [row.split(" | ")[0][2:] for row in tables[3][2:]] == [PHOTOGRAPHS, PLAIN, "synthetic, then photographs"]
    assert f"less {PLAIN}" in tables[0][0]
    assert f"less {PHOTOGRAPHS}" in tables[3][0]
    options = {each.name: json.loads((each / "run.json").read_text())["options"] for each in tmp_path.iterdir()}
    assert len(options) == 8
    assert options["relu-1"] == {**options["n-synthetic-only-1"], "activation": "relu"}
    assert options["photographs-only-0"]["order"] == "real"
    monkeypatch.setattr(training.Study, "_train", lambda *_: pytest.fail("trained again"))
    assert main(words) == 0
    assert capsys.readouterr().out == printed


def test_groups_begin_with_what_others_are_compared_with() -> None:
    assert [next(iter(group)) for group in GROUPS.values()] == [PLAIN, PHOTOGRAPHS]
    assert PLAIN in ORDERS, "trained once for both groups"


def test_steps_are_timed_in_both_precisions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = Size(1, 2, 1.0, 1.0, frame_px=(96, 96), batch=2)
    lines = list(learning.lines(tmp_path / "here", size))
    assert all(line.value == pytest.approx(2 / line.took_s) for line in lines if line.value is not None)
    assert lines[1].value is not None
    assert (lines[0].value is not None) == has_half(torch.device("cpu"))
    monkeypatch.setattr(machine, "HALF_INSTRUCTIONS", ())
    assert [line.value is None for line in learning.lines(tmp_path / "without", size)] == [True, False]
