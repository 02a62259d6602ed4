"""Untrained networks in a comparison: sizes and operations as published, and no accuracy."""

import csv
from pathlib import Path

import pytest

from pavetwin.training.network.architecture import variant
from pavetwin.training.trainer.export import gflops_of
from scenes.command_line import pavetwin

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("size", "published"), [("n", 8.7), ("s", 28.6)])
def test_operations_are_those_of_the_architecture(size: str, published: float) -> None:
    """Three classes instead of 80 take a little less; ReLU changes nothing."""
    assert 0.9 * published < gflops_of(variant(size).as_mapping()) < published
    assert gflops_of(variant(size).as_mapping()) == gflops_of(variant(size, activation="relu").as_mapping())


def test_the_command_measures_a_network_without_training(tmp_path: Path) -> None:
    done = pavetwin("compare", "--sizes", "n", "--frames", "1", "-o", "models.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "models.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["model"], row["mAP@0.5"], row["GFLOPs"]) == ("n, untrained", "", "8.1")
    assert row["FPS, n = 1"] == "1.00"
    assert 12 < float(row["size, MB"]) < 13
