"""What the epochs of a run show, and when a phase ends before its last one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.labels.class_names import CLASSES
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.trainer import trainer
from pavetwin.training.trainer.batches import TrainingViews
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent

TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, epochs=4, classifier_epochs=1, batch=4, warmup_epochs=1, mosaic_off=0
)

pytestmark = pytest.mark.slow


def phases(run: Path) -> list[str]:
    """The phase of each epoch."""
    return [row.split(",")[0] for row in (run / "curves.csv").read_text().splitlines()[1:]]


@pytest.mark.parametrize(("patience", "epochs"), [(1, 2), (2, 3), (9, 4)])
def test_a_phase_ends_after_as_many_epochs_without_a_better_result(
    data: list[ExampleSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, patience: int, epochs: int
) -> None:
    """All epochs are as good as the first."""
    monkeypatch.setattr(Trainer, "_validate", lambda _: np.full((len(CLASSES), 10), 0.5))
    options = replace(TINY, patience=patience, classifier_epochs=0)
    Trainer(data, tmp_path / "run", options, TrainingMachine("cpu"), Silent()).run()
    assert phases(tmp_path / "run") == ["all"] * epochs


def test_the_last_epochs_and_the_classifier_s_are_without_mosaics(
    data: list[ExampleSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, int, float]] = []

    def views(members: Any, order: Any, known: Any, options: Any, mask_px: Any, key: Any, *others: Any) -> Any:
        shown.append((key[1], key[2], options.mosaic))
        return TrainingViews(members, order, known, options, mask_px, key, *others)

    monkeypatch.setattr(trainer, "TrainingViews", views)
    options = replace(TINY, mosaic=0.7, mosaic_off=2)
    Trainer(data, tmp_path / "run", options, TrainingMachine("cpu"), Silent()).run()
    assert shown == [(0, 0, 0.7), (0, 1, 0.7), (0, 2, 0.0), (0, 3, 0.0), (1, 0, 0.0)]
