"""The mean of the weights of runs that began with the same weights, and which runs have none."""

import json
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
import torch

from pavetwin.errors import PaveTwinError
from pavetwin.perception.inference import Detector
from pavetwin.training.datasets.examples import read_coco
from pavetwin.training.trainer.architecture import variant
from pavetwin.training.trainer.averaging import averaged_network
from pavetwin.training.trainer.exported import exported_network
from pavetwin.training.trainer.network import DetectorNetwork
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

SMALL = {"width": 0.0625, "depth": 0.1}
OPTIONS = {"image_px": 96, "native": True}


def run_of(
    folder: Path, seed: int, *, start: str | None = "synthetic-7.onnx", options: Any = OPTIONS, **others: Any
) -> Path:
    """A finished run of a small network with random weights."""
    torch.manual_seed(seed)
    network = DetectorNetwork(variant("n", **{**SMALL, **others}))
    for name, value in network.named_buffers():
        if name.endswith("num_batches_tracked"):
            value.fill_(seed)
    folder.mkdir()
    weights = {"format": 1, "architecture": network.architecture.as_mapping(), "weights": network.state_dict()}
    torch.save({**weights, "options": options, "epoch": seed}, folder / "best.pt")
    (folder / "run.json").write_text(json.dumps({"options": options, "data": [str(seed)], "start": start}))
    return folder


def weights(run: Path) -> dict[str, torch.Tensor]:
    return dict(torch.load(run / "best.pt", weights_only=True)["weights"])


def test_the_mean_of_three_runs_is_that_of_each_weight(tmp_path: Path) -> None:
    runs = [run_of(tmp_path / f"seed-{seed}", seed) for seed in (1, 2, 3)]
    network, told = averaged_network(runs)
    assert not network.training
    assert told["epoch"] == 1
    states = [weights(run) for run in runs]
    for name, value in network.state_dict().items():
        if name.endswith("num_batches_tracked"):
            assert int(value) == 1
        else:
            torch.testing.assert_close(value, sum(state[name] for state in states) / 3)


def test_one_run_is_as_it_is_and_files_without_settings_are_taken(tmp_path: Path) -> None:
    one, other = (run_of(tmp_path / name, seed, start=None) for name, seed in (("one", 1), ("other", 2)))
    network, _ = averaged_network([one])
    for name, value in network.state_dict().items():
        assert torch.equal(value, weights(one)[name])
    for run in (one, other):
        (run / "run.json").unlink()
    mean, _ = averaged_network([one / "best.pt", other / "best.pt"])
    for name, value in mean.state_dict().items():
        if value.is_floating_point():
            torch.testing.assert_close(value, (weights(one)[name] + weights(other)[name]) / 2)


def test_a_mean_is_exported_and_knows_all_its_runs(tmp_path: Path) -> None:
    runs = [run_of(tmp_path / f"seed-{seed}", seed) for seed in (1, 2)]
    done = pavetwin("export", *runs, "-o", tmp_path / "mean.onnx")
    assert done.returncode == 0, done.stderr
    assert "mean.onnx, the mean of 2 runs, " in done.stdout
    recipe = sha256(b"".join((run / "run.json").read_bytes() for run in runs)).hexdigest()
    assert Detector(tmp_path / "mean.onnx").facts.recipe == recipe
    image = torch.rand(1, 3, 96, 96)
    with torch.no_grad():
        of_mean, of_one = (averaged_network(each)[0](image).maps for each in (runs, runs[:1]))
        of_file = exported_network(tmp_path / "mean.onnx").eval()(image).maps
    away, apart = ((of_file - maps).abs().max() for maps in (of_mean, of_one))
    assert 0 < 20 * away < apart
    (runs[1] / "run.json").unlink()
    assert pavetwin("export", *runs, "-o", tmp_path / "mean.onnx").returncode == 0
    assert Detector(tmp_path / "mean.onnx").facts.recipe == ""  # that of one run would be wrong


def test_what_training_writes_tells_which_runs_belong_together(tmp_path: Path) -> None:
    """Weights of two starts have the same name, `best.pt`; what they say counts."""
    data = [read_coco(drawn_roads(tmp_path / "data", {"train": 4, "val": 2}, size=(64, 48)), ("train", "val"))]
    tiny = TrainingOptions(width=0.03, depth=0.01, image_px=64, epochs=1, classifier_epochs=0, batch=4, seed=1)

    def trained(name: str, seed: int, start: Path | None = None) -> Path:
        options, machine = replace(tiny, seed=seed), TrainingMachine(device="cpu")
        assert Trainer(data, tmp_path / name, options, machine, Silent(), start).run()
        return tmp_path / name

    one, other = trained("one", 1), trained("other", 2)
    of_one = [trained(f"of-one-{seed}", seed, one / "best.pt") for seed in (3, 4)]
    of_other = trained("of-other", 5, other / "best.pt")
    averaged_network(of_one)
    copied = tmp_path / "copied.pt"
    copied.write_bytes((one / "best.pt").read_bytes())
    averaged_network([*of_one, trained("of-copied", 6, copied)])  # the same weights by another name
    with pytest.raises(PaveTwinError, match="began with other weights"):
        averaged_network([of_one[0], of_other])
    with pytest.raises(PaveTwinError, match="began with random weights"):
        averaged_network([one, other])
    (of_other / "run.json").unlink()
    with pytest.raises(PaveTwinError, match="began with other weights"):
        averaged_network([of_one[0] / "best.pt", of_other / "best.pt"])


@pytest.mark.parametrize(
    ("others", "told"),
    [
        ({"start": None}, "began with random weights"),
        ({"start": "synthetic-1.onnx"}, r"began with other weights \('synthetic-1.onnx'\)"),
        ({"options": {**OPTIONS, "image_px": 128}}, "image_px 128"),
        ({"options": {**OPTIONS, "native": False}}, "with native no, '.*' with True"),
        ({"options": {**OPTIONS, "without": "Person,Car"}}, "without Person,Car, '.*' with nothing"),
        ({"options": None}, "image_px nothing"),
        ({"activation": "relu"}, "another architecture"),
    ],
)
def test_runs_that_do_not_belong_together_have_no_mean(tmp_path: Path, others: dict[str, Any], told: str) -> None:
    runs = [run_of(tmp_path / "first", 1), run_of(tmp_path / "second", 2, **others)]
    with pytest.raises(PaveTwinError, match=told):
        averaged_network(runs)


def test_a_run_given_twice_and_one_that_is_missing_are_refused(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", 1)
    assert "is given before it" in plain_refusal(pavetwin("export", run, run / "best.pt", "-o", tmp_path / "mean.onnx"))
    assert "There is no run" in plain_refusal(pavetwin("export", run, tmp_path / "no", "-o", tmp_path / "mean.onnx"))
    assert not (tmp_path / "mean.onnx").exists()


@pytest.mark.parametrize("text", ["", "{}", "[]", "\xff"])
def test_settings_that_are_damaged_are_refused(tmp_path: Path, text: str) -> None:
    runs = [run_of(tmp_path / name, seed) for seed, name in enumerate(("one", "other"))]
    (runs[1] / "run.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(PaveTwinError, match="is damaged, so that it does not say what the run began with"):
        averaged_network(runs)


def test_a_mean_of_nothing_is_refused() -> None:
    with pytest.raises(PaveTwinError, match="name one at least"):
        averaged_network([])
