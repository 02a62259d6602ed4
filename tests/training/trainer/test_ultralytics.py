"""The adapter with Ultralytics itself, where somebody has installed it beside (AGPL-3.0)."""

import csv
from importlib.util import find_spec
from pathlib import Path

import pytest

from pavetwin.training.evaluation.comparison import compared_ultralytics
from pavetwin.training.trainer.cost import gflops
from scenes.command_line import pavetwin

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("ultralytics") is None, reason="ultralytics is no part of PaveTwin, nor installed"),
]


@pytest.mark.parametrize(("name", "size_mb", "operations"), [("yolov8n", 12.6, 8.7), ("yolo11n", 10.5, 6.5)])
def test_sizes_and_operations_are_the_published_ones(name: str, size_mb: float, operations: float) -> None:
    row = compared_ultralytics(name, name, split=None, frames=1, threads=1, count=gflops)
    assert row.size_mb == pytest.approx(size_mb, rel=0.02)
    assert row.gflops == pytest.approx(operations, rel=0.02)
    assert row.map50 is None
    assert row.frames_per_s > 0


def test_the_command_tells_the_licence(tmp_path: Path) -> None:
    done = pavetwin("compare", "--ultralytics", "yolo11n", "--frames", "1", "-o", "models.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Ultralytics is licensed under AGPL-3.0")
    with (tmp_path / "models.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["model"], row["mAP@0.5"]) == ("yolo11n, untrained", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["models.csv"]
