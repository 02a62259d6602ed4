"""Runs with unlabelled photographs: each switch takes part, none of them changes a run that does without."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.perception.classes import ROAD_DEFECT
from pavetwin.training.datasets.examples import ExampleSet, read_coco
from pavetwin.training.datasets.unlabelled import read_unlabelled
from pavetwin.training.trainer import self_training
from pavetwin.training.trainer.detect import ImageDetections
from pavetwin.training.trainer.network import DetectorNetwork
from pavetwin.training.trainer.options import LossWeights, TrainingMachine, TrainingOptions
from pavetwin.training.trainer.self_training import MeanTeacher, PhotographViews
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent
from scenes.drawn_roads import drawn_roads

TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, epochs=2, classifier_epochs=0, batch=4, warmup_epochs=1, mosaic_off=1, seed=3
)
SURE = {"teacher_weight": 1.0, "teacher_confidence": 0.001, "teacher_doubt": 0.0, "teacher_photographs": 2}
"""A teacher that believes nearly all of what it says: one that is not trained is never sure of anything."""

SWITCHES: dict[str, Mapping[str, Any]] = {
    "fourier": {"fourier": 0.05},
    "appearance": {"appearance": 1.0},
    "teacher": {**SURE, "teacher_after": 1},
}

CPU = TrainingMachine(device="cpu")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> list[ExampleSet]:
    folder = drawn_roads(tmp_path_factory.mktemp("data"), {"train": 12, "val": 3}, size=(64, 48), synthetic=True)
    return [read_coco(folder, ("train", "val"))]


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> ExampleSet:
    folder = tmp_path_factory.mktemp("photographs")
    for at in range(3):
        rng = np.random.default_rng(at)
        Image.fromarray(rng.integers(90, 250, (60, 80, 3), dtype=np.uint8)).save(folder / f"{at}.png")
    return read_unlabelled(folder)


@pytest.fixture(scope="module")
def plain(data: list[ExampleSet], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without any switch."""
    path = tmp_path_factory.mktemp("runs") / "plain"
    assert Trainer(data, path, TINY, CPU, Silent()).run()
    return path


def weights(run: Path) -> dict[str, Any]:
    """Of the last step: the best epoch may be one before a switch works."""
    return dict(torch.load(run / "checkpoint.pt", weights_only=True)["network"])


def is_same(one: Path, other: Path) -> bool:
    mine, theirs = weights(one), weights(other)
    return all(torch.equal(value, theirs[name]) for name, value in mine.items())


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_takes_part_and_a_run_in_chunks_is_the_same(
    name: str, plain: Path, data: list[ExampleSet], photographs: ExampleSet, tmp_path: Path
) -> None:
    options = replace(TINY, **SWITCHES[name])
    trainer = Trainer(data, tmp_path / "whole", options, CPU, Silent(), photographs=photographs)
    assert trainer.run()
    assert not is_same(tmp_path / "whole", plain)
    assert [("taught" in row and row["taught"] > 0) for row in trainer.curves] == [False, name == "teacher"]
    heading = (tmp_path / "whole" / "curves.csv").read_text().splitlines()[0]
    assert heading.endswith(",taught") == (name == "teacher")
    while not Trainer(data, tmp_path / "run", options, CPU, Silent(), photographs=photographs).run(stop_after_s=0.0):
        pass
    assert is_same(tmp_path / "run", tmp_path / "whole")
    assert (tmp_path / "run" / "curves.csv").read_bytes() == (tmp_path / "whole" / "curves.csv").read_bytes()


def test_before_its_epoch_a_teacher_changes_nothing(
    plain: Path, data: list[ExampleSet], photographs: ExampleSet, tmp_path: Path
) -> None:
    """The first epoch has the same losses; the heads of regions are trained without it afterwards."""
    options = replace(TINY, **SWITCHES["teacher"], classifier_epochs=1)
    trainer = Trainer(data, tmp_path / "run", options, CPU, Silent(), photographs=photographs)
    trainer.run()
    rows = [line.split(",") for line in (plain / "curves.csv").read_text().splitlines()]
    first, second = ([str(row[name]) for name in rows[0][:9]] for row in trainer.curves[:2])
    assert first == rows[1][:9]
    assert second != rows[2][:9]
    assert trainer.curves[2]["taught"] == 0


def test_a_run_begun_before_the_switches_were_there_goes_on(
    plain: Path, data: list[ExampleSet], tmp_path: Path
) -> None:
    """Its settings do not name them, and its checkpoint of the middle of an epoch has no sum of theirs."""
    run = tmp_path / "run"
    assert not Trainer(data, run, TINY, CPU, Silent()).run(stop_after_s=0.0)
    settings = json.loads((run / "run.json").read_text())
    later = ("fourier", "appearance", *(name for name in settings["options"] if name.startswith("teacher_")))
    assert len(later) == 7
    for name in later:
        del settings["options"][name]
    (run / "run.json").write_text(json.dumps(settings))
    state = torch.load(run / "checkpoint.pt", weights_only=True)
    assert state["progress"]["step"] == 1
    del state["progress"]["sums"][6:]
    torch.save(state, run / "checkpoint.pt")
    assert Trainer(data, run, TINY, CPU, Silent()).run()
    assert is_same(run, plain)
    assert (run / "curves.csv").read_bytes() == (plain / "curves.csv").read_bytes()


def refusal(*arguments: Any, **named: Any) -> str:
    with pytest.raises(PaveTwinError) as refused:
        Trainer(*arguments, **named)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_photographs_and_switches_belong_together(
    data: list[ExampleSet], photographs: ExampleSet, tmp_path: Path
) -> None:
    run, fourier = tmp_path / "run", replace(TINY, fourier=0.01)
    assert refusal(data, run, fourier, CPU, Silent()).startswith("`fourier` needs photographs without labels")
    told = refusal(data, run, TINY, CPU, Silent(), photographs=photographs)
    assert told.startswith("`photographs`: no setting uses them; give fourier, appearance or teacher_weight")
    real = [replace(each, examples=tuple(replace(one, is_synthetic=False) for one in each.examples)) for each in data]
    told = refusal(real, run, fourier, CPU, Silent(), photographs=photographs)
    assert told == "`fourier` changes synthetic images, and the datasets have none to train on."
    assert not run.exists()
    with pytest.raises(PaveTwinError, match=r"`teacher_doubt` 0.7: it is at most `teacher_confidence` \(0.6\)"):
        TrainingOptions(teacher_doubt=0.7)


def test_a_run_with_other_photographs_is_refused(
    data: list[ExampleSet], photographs: ExampleSet, tmp_path: Path
) -> None:
    options = replace(TINY, fourier=0.01)
    Trainer(data, tmp_path / "run", options, CPU, Silent(), photographs=photographs)
    other = replace(photographs, fingerprint="0" * 64)
    assert "holds a run with photographs " in refusal(data, tmp_path / "run", options, CPU, Silent(), photographs=other)


@pytest.mark.parametrize("workers", [0, 1])
def test_a_photograph_that_cannot_be_read_ends_the_run_by_name(
    data: list[ExampleSet], tmp_path: Path, workers: int
) -> None:
    whole = Image.effect_noise((64, 64), 40).convert("RGB")
    whole.save(tmp_path / "cut.jpg")
    (tmp_path / "cut.jpg").write_bytes((tmp_path / "cut.jpg").read_bytes()[:700])
    options = replace(TINY, fourier=0.01)
    machine = TrainingMachine("cpu", workers=workers)
    trainer = Trainer(data, tmp_path / "run", options, machine, Silent(), photographs=read_unlabelled(tmp_path))
    with pytest.raises(PaveTwinError) as told:
        trainer.run()
    assert str(told.value).startswith("The picture 'cut.jpg' of ")
    assert "\n" not in str(told.value)


def said(rows: list[tuple[tuple[float, ...], int, float, int]]) -> ImageDetections:
    """Of boxes, coarse classes, confidences and subtypes."""
    subtypes = torch.zeros(len(rows), 3)
    for at, (_, coarse, _, subtype) in enumerate(rows):
        if coarse == ROAD_DEFECT:
            subtypes[at, subtype] = 0.9
    boxes, coarse, confidences, _ = zip(*rows, strict=True) if rows else ([], [], [], [])
    return ImageDetections(
        torch.tensor(boxes, dtype=torch.float32).reshape(-1, 4),
        torch.tensor(coarse, dtype=torch.int64),
        torch.tensor(confidences, dtype=torch.float32),
        subtypes,
        None,
    )


BOX, OTHER = (8.0, 8.0, 40.0, 40.0), (40.0, 4.0, 60.0, 30.0)


def test_sure_detections_are_objects_and_doubtful_ones_are_ignored(
    photographs: ExampleSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second photograph is judged by nothing; cars are not judged in the first, nor anywhere if not trained."""
    rows = [(BOX, 0, 0.8, 2), (OTHER, 0, 0.4, 1), (BOX, 2, 0.5, 0), (OTHER, 1, 0.9, 0)]
    monkeypatch.setattr(self_training, "detect", lambda *_, **__: [said(rows), said([])])
    network = DetectorNetwork(TINY.architecture).eval()
    teacher = MeanTeacher(photographs, replace(TINY, teacher_weight=1.0), frozenset({0, 2}))
    targets = teacher.targets(network, torch.zeros(2, 3, 64, 64))
    assert targets.ignored.tolist() == [False, True, True, False]
    assert targets.images.tolist() == [0, 0, 0, 0]
    assert targets.known.tolist() == [[True, False, False], [False, False, False]]
    assert targets.regions.tolist() == [[0.0, *BOX]]
    assert targets.subtypes.tolist() == [2]
    assert not targets.has_mask.any()


def test_what_the_teacher_says_is_learned_and_nothing_else_is(
    photographs: ExampleSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scores within its box rise, those of other places and of a class that is not judged stay or fall."""
    torch.manual_seed(0)
    network = DetectorNetwork(TINY.architecture)
    teacher = MeanTeacher(photographs, replace(TINY, teacher_weight=1.0), frozenset({0, 1, 2}))
    monkeypatch.setattr(self_training, "detect", lambda *_, **__: [said([(BOX, 0, 0.8, 2)])])
    images = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(0)).repeat(2, 1, 1, 1)
    targets = teacher.targets(network, images[:1])
    boxes = [each.clone() for each in network.detection.boxes.parameters()]
    optimiser = torch.optim.AdamW(network.parameters(), lr=0.003, weight_decay=0.0)
    scores = []
    for _ in range(40):
        encoded = network(images).images(slice(1))
        scores.append(encoded.scores[0].sigmoid().detach())
        optimiser.zero_grad()
        teacher.loss(network, encoded, targets, LossWeights()).backward()
        optimiser.step()
    centres = encoded.anchors.centres
    inside = ((centres > 8) & (centres < 40)).all(dim=1)
    assert scores[-1][inside, 0].max() > 3 * scores[0][inside, 0].max()
    assert scores[-1][~inside, 0].max() < scores[-1][inside, 0].max()
    assert all(torch.equal(*each) for each in zip(boxes, network.detection.boxes.parameters(), strict=True))
    bare = teacher.loss(network, encoded, replace(targets, known=torch.zeros_like(targets.known)), LossWeights())
    assert bare.isfinite()


def test_a_photograph_of_which_nothing_is_said_teaches_nothing(
    photographs: ExampleSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    network = DetectorNetwork(TINY.architecture)
    teacher = MeanTeacher(photographs, replace(TINY, teacher_weight=1.0), frozenset({0, 1, 2}))
    monkeypatch.setattr(self_training, "detect", lambda *_, **__: [said([(BOX, 0, 0.3, 2)])])
    images = torch.rand(1, 3, 64, 64).repeat(2, 1, 1, 1)
    targets = teacher.targets(network, images[:1])
    assert teacher.loss(network, network(images).images(slice(1)), targets, LossWeights()).item() == 0.0


def test_the_network_sees_the_same_view_in_other_colours(photographs: ExampleSet) -> None:
    views = PhotographViews(photographs, TINY.views(mosaic=False), 12, (3, 0, 1))
    agreement = []
    for at in range(12):
        plain, varied = (each.numpy().mean(axis=0) for each in views[at])
        assert not np.array_equal(plain, varied)
        is_seen = varied != 114
        agreement.append(np.corrcoef(plain[is_seen], varied[is_seen])[0, 1])
        assert all(torch.equal(*pair) for pair in zip(views[at], views[at], strict=True))
    assert np.mean(agreement) > 0.85
    other = PhotographViews(photographs, TINY.views(mosaic=False), 12, (3, 0, 2))
    assert not torch.equal(views[0][0], other[0][0])
