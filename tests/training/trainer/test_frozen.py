"""Runs that train a part of the network alone: the level that the weights to begin with lack, or the heads of
regions."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.trainer.export import export
from pavetwin.training.trainer.exported import exported_network
from pavetwin.training.trainer.network import DetectorNetwork
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.run_folder import load_network, load_weights
from pavetwin.training.trainer.schedule import phases_of
from pavetwin.training.trainer.trained_part import trained_part
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent
from scenes.command_line import pavetwin

TINY = TrainingOptions(
    width=0.03, depth=0.01, image_px=64, epochs=2, classifier_epochs=0, batch=4, warmup_epochs=1, mosaic_off=1, seed=3
)
WITH_LEVEL = replace(TINY, p2=True, freeze=True, epochs=1)
CPU = TrainingMachine(device="cpu")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def before(data: list[ExampleSet], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights without the level of stride 4."""
    run = tmp_path_factory.mktemp("before")
    Trainer(data, run, TINY, CPU, Silent()).run()
    return run / "best.pt"


def test_a_frozen_run_changes_what_it_began_without_and_nothing_else(
    data: list[ExampleSet], before: Path, tmp_path: Path
) -> None:
    Trainer(data, tmp_path / "run", WITH_LEVEL, CPU, Silent(), start=before).run()
    fresh = DetectorNetwork(WITH_LEVEL.architecture)
    lacking = load_weights(fresh, before)
    state = load_network(tmp_path / "run" / "best.pt")[0].state_dict()
    kept = load_network(before)[0].state_dict()
    assert lacking
    assert lacking.isdisjoint(kept)
    assert kept.keys() < state.keys()
    assert all(torch.equal(state[name], value) for name, value in kept.items()), "statistics of normalisations too"
    learned = [name for name, _ in fresh.named_parameters() if name in lacking]
    norms = [name for name in lacking if name.endswith("running_mean")]
    with torch.random.fork_rng():
        torch.manual_seed(WITH_LEVEL.seed)
        began = DetectorNetwork(WITH_LEVEL.architecture).state_dict()
    for name in (*learned, *norms):
        assert not torch.equal(state[name], began[name]), name


def test_a_frozen_run_from_an_exported_model_can_be_trained_on(
    data: list[ExampleSet], before: Path, tmp_path: Path
) -> None:
    """The three levels say what the model says, and their normalisations have the statistics of training images."""
    export(before, tmp_path / "model.onnx")
    Trainer(data, tmp_path / "run", WITH_LEVEL, CPU, Silent(), start=tmp_path / "model.onnx").run()
    model, frozen = exported_network(tmp_path / "model.onnx"), load_network(tmp_path / "run" / "best.pt")[0]
    images = torch.rand(2, 3, 64, 96, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        said, kept = (network(images) for network in (model, frozen))
    coarse = said.scores.shape[1]
    torch.testing.assert_close(kept.scores[:, :coarse], said.scores, rtol=0, atol=1e-3)
    torch.testing.assert_close(kept.boxes[:, :coarse], said.boxes, rtol=0, atol=1e-2)
    norm = frozen.backbone.stem.norm
    assert not torch.equal(norm.running_var, torch.ones_like(norm.running_var))


def test_a_frozen_run_in_chunks_is_the_same_run(data: list[ExampleSet], before: Path, tmp_path: Path) -> None:
    Trainer(data, tmp_path / "whole", WITH_LEVEL, CPU, Silent(), start=before).run()
    while not Trainer(data, tmp_path / "chunks", WITH_LEVEL, CPU, Silent(), start=before).run(stop_after_s=0):
        pass
    whole, chunks = (load_network(tmp_path / name / "best.pt")[0].state_dict() for name in ("whole", "chunks"))
    assert all(torch.equal(value, chunks[name]) for name, value in whole.items())


def test_a_frozen_run_has_no_epochs_of_the_heads_of_regions(folder: Path, before: Path, tmp_path: Path) -> None:
    words = ("train", folder, "-o", tmp_path / "run", "--image", 64, "--batch", 4, "--epochs", 1, "--device", "cpu")
    tiny = ("--set", "width=0.03", "--set", "depth=0.01")
    done = pavetwin(*words, *tiny, "--start", before, "--set", "p2=true", "--set", "freeze=true")
    assert done.returncode == 0, done.stderr
    (row,) = csv.DictReader((tmp_path / "run" / "curves.csv").read_text().splitlines())
    assert (row["phase"], float(row["subtype"]), float(row["mask"])) == ("all", 0.0, 0.0)
    assert float(row["box"]) > 0


def test_the_heads_of_regions_are_trained_alone_afterwards(data: list[ExampleSet]) -> None:
    """What they look at stays as it is: no weight before them learns, and no normalisation forgets."""
    options = replace(TINY, classifier_epochs=1)
    members = [(each, example) for each in data for example in each.examples]
    detector, classifier = phases_of(members, options)
    network = DetectorNetwork(options.architecture)
    part = trained_part(network, classifier, options, ())
    part.begin_step()
    assert {id(each) for each in part.weights} == {id(each) for each in network.regions.parameters()}
    assert network.regions.subtype[0].norm.training
    assert not network.backbone.stem.norm.training
    everything = trained_part(network, detector, options, ())
    everything.begin_step()
    assert len(everything.weights) == len(list(network.parameters()))
    assert network.backbone.stem.norm.training
    assert all(each.requires_grad for each in everything.weights)


def test_a_run_that_would_keep_nothing_or_everything_is_refused(
    data: list[ExampleSet], before: Path, tmp_path: Path
) -> None:
    with pytest.raises(PaveTwinError, match=r"name some \(`start`\)"):
        Trainer(data, tmp_path / "run", WITH_LEVEL, CPU, Silent())
    with pytest.raises(PaveTwinError, match="`start` must lack it; here there is nothing"):
        Trainer(data, tmp_path / "run", replace(WITH_LEVEL, p2=False), CPU, Silent(), start=before)
    assert not (tmp_path / "run").exists()
