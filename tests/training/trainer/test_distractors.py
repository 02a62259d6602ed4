"""Random shapes where nothing is labelled."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import read_coco
from pavetwin.training.trainer import trainer as training
from pavetwin.training.trainer.distractors import with_distractors
from pavetwin.training.trainer.network import Encoded
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.schedule import Phase
from pavetwin.training.trainer.targets import Targets, no_targets
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent
from scenes.drawn_roads import drawn_roads

SIDE = 96
MANY = 32
TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, epochs=1, classifier_epochs=0, batch=4, warmup_epochs=0, mosaic_off=0
)


def _labelled(images: int, boxes: list[list[float]], of: list[int], ignored: bool = False) -> Targets:
    return replace(
        no_targets(images, 3, 28),
        boxes=torch.tensor(boxes).reshape(-1, 4),
        classes=torch.zeros(len(boxes), dtype=torch.int64),
        images=torch.tensor(of, dtype=torch.int64),
        ignored=torch.full((len(boxes),), ignored),
    )


def _changed(before: Tensor, after: Tensor) -> Tensor:
    """(batch, rows, columns)"""
    return ((after - before).abs() > 1e-6).any(dim=1)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10_000),
    st.tuples(st.floats(0, 60), st.floats(0, 60), st.floats(4, 36), st.floats(4, 36)),
    st.booleans(),
)
def test_nothing_labelled_changes_even_where_it_is_ignored(
    seed: int, place: tuple[float, float, float, float], ignored: bool
) -> None:
    left, top, width, height = place
    images = torch.rand(2, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(seed))
    targets = _labelled(2, [[left, top, left + width, top + height]], [1], ignored)
    drawn = with_distractors(images, targets, MANY, np.random.default_rng(seed))
    window = np.s_[1, :, int(top) : int(np.ceil(top + height)), int(left) : int(np.ceil(left + width))]
    torch.testing.assert_close(drawn[window], images[window], atol=0, rtol=0)
    assert drawn.min() >= 0
    assert drawn.max() <= 1


def test_they_cover_a_good_part_of_what_is_free_and_vary() -> None:
    images = torch.full((64, 3, SIDE, SIDE), 0.5)
    drawn = with_distractors(images, no_targets(64, 3, 28), 4, np.random.default_rng(1))
    shares = _changed(images, drawn).float().mean(dim=(1, 2))
    assert 0.2 < shares.median() < 0.95
    assert shares.std() > 0.1
    assert (drawn - images).abs().amax(dim=(1, 2, 3)).min() > 0.02


def test_an_image_full_of_labels_stays_and_the_others_do_not() -> None:
    images = torch.full((2, 3, SIDE, SIDE), 0.5)
    full = _labelled(2, [[0.0, 0.0, float(SIDE), float(SIDE)]], [0])
    changed = _changed(images, with_distractors(images, full, MANY, np.random.default_rng(2)))
    assert not changed[0].any()
    assert changed[1].float().mean() > 0.1


def test_the_seed_decides() -> None:
    images, nothing = torch.full((3, 3, SIDE, SIDE), 0.5), no_targets(3, 3, 28)
    first, again, other = (with_distractors(images, nothing, 3, np.random.default_rng(seed)) for seed in (4, 4, 5))
    torch.testing.assert_close(first, again, atol=0, rtol=0)
    assert not torch.allclose(first, other)


@pytest.mark.parametrize("views", ["processor", "device"])
def test_the_network_sees_them_and_a_stopped_training_goes_on_to_the_same_weights(
    views: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = read_coco(drawn_roads(tmp_path / "data", {"train": 8, "val": 2}, size=(64, 48)), ("train", "val"))
    machine = TrainingMachine(device="cpu", views=views)
    seen: list[Tensor] = []
    encode = Trainer._encode

    def watched(self: Trainer, images: Tensor, phase: Phase) -> Encoded:
        seen.append(images.clone())
        return encode(self, images, phase)

    monkeypatch.setattr(Trainer, "_encode", watched)

    def trained(name: str, distractors: int) -> tuple[Trainer, list[Tensor]]:
        seen.clear()
        options = replace(TINY, distractors=distractors)
        trainer = Trainer([data], tmp_path / name, options, machine, Silent())
        assert trainer.run()
        return trainer, list(seen)

    whole, painted = trained("whole", MANY)
    _, plain = trained("plain", 0)
    assert len(painted) == len(plain) == 2
    changes = [after - before for after, before in zip(painted, plain, strict=True)]
    assert all((each != 0).any() for each in changes)
    stopped = Trainer([data], tmp_path / "stopped", replace(TINY, distractors=MANY), machine, Silent())
    assert not stopped.run(stop_after_s=0)
    continued, _ = trained("stopped", MANY)
    for mine, theirs in zip(continued.network.parameters(), whole.network.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs, atol=0, rtol=0)


def test_each_step_has_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = read_coco(drawn_roads(tmp_path / "data", {"train": 8, "val": 2}, size=(64, 48)), ("train", "val"))
    numbers: list[float] = []

    def recorded(images: Tensor, _targets: Targets, _count: int, rng: np.random.Generator) -> Tensor:
        numbers.append(float(rng.random()))
        return images

    monkeypatch.setattr(training, "with_distractors", recorded)
    options = replace(TINY, distractors=3, epochs=2, classifier_epochs=1)
    assert Trainer([data], tmp_path / "run", options, TrainingMachine(device="cpu"), Silent()).run()
    assert len(set(numbers)) == len(numbers) == 6


def test_a_number_out_of_range_is_refused() -> None:
    with pytest.raises(PaveTwinError, match="`distractors` 65"):
        TrainingOptions(distractors=65)
