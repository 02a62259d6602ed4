"""What cannot be trained from, as a user types it: one plain line, exit code 2, and nothing that was there is lost."""

import json
import shutil
from pathlib import Path

import pytest
import torch

from pavetwin.training.trainer.run_folder import RunFolder, load_network
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_detector import FILE
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

TINY = (
    *("--image", 64, "--epochs", 1, "--batch", 4, "--device", "cpu", "--set", "width=0.03", "--set", "depth=0.01"),
    *("--set", "classifier_epochs=0"),
)


@pytest.fixture(scope="module")
def trained(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "run"
    done = pavetwin("train", folder, "-o", run, *TINY)
    assert done.returncode == 0, done.stderr
    return run


def content_of(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_dataset_without_a_class(tmp_path: Path) -> None:
    names = ("Pothole", "Single Crack", "Car")
    drawn_roads(tmp_path / "roads", {"train": 9, "val": 2}, size=(64, 48), names=names)
    line = plain_refusal(pavetwin("train", tmp_path / "roads", "-o", tmp_path / "run", *TINY))
    assert line == (
        "Error: No training image shows a labelled Crocodile Crack, Person; add a dataset that has some, or leave them "
        "out (--without 'Crocodile Crack,Person')."
    )
    assert not (tmp_path / "run").exists()
    told = ("--without", "Crocodile Crack,Person")
    assert pavetwin("train", tmp_path / "roads", "-o", tmp_path / "run", *TINY, *told).returncode == 0


def test_labels_out_of_range(tmp_path: Path) -> None:
    drawn_roads(tmp_path / "roads", {"train": 9, "val": 2}, size=(64, 48))
    labels = tmp_path / "roads" / "annotations" / "instances_train.json"
    told = json.loads(labels.read_text())
    told["annotations"][3]["category_id"] = 99
    labels.write_text(json.dumps(told))
    before = content_of(tmp_path / "roads")
    line = plain_refusal(pavetwin("train", tmp_path / "roads", "-o", tmp_path / "run", *TINY))
    assert "instances_train.json" in line
    assert "99" in line
    assert not (tmp_path / "run").exists()
    assert content_of(tmp_path / "roads") == before


def test_a_run_of_other_settings(folder: Path, trained: Path) -> None:
    before = content_of(trained)
    line = plain_refusal(pavetwin("train", folder, "-o", trained, *TINY, "--set", "rate=0.5"))
    assert "holds a run with rate 0.001, not 0.5" in line
    assert content_of(trained) == before


def test_a_run_that_began_with_other_weights_of_the_same_name(folder: Path, trained: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        network, told = load_network(trained / "best.pt")
        with torch.no_grad():
            next(network.parameters()).add_(0.0 if name == "a" else 0.01)
        (tmp_path / name).mkdir()
        RunFolder(tmp_path / name).save_best(network, told)
    words = ("train", folder, "-o", tmp_path / "run", *TINY, "--start")
    assert pavetwin(*words, tmp_path / "a" / "best.pt").returncode == 0
    before = content_of(tmp_path / "run")
    line = plain_refusal(pavetwin(*words, tmp_path / "b" / "best.pt"))
    assert "holds a run with start_sha256" in line
    assert content_of(tmp_path / "run") == before


@pytest.mark.parametrize("minutes", ["-1", "nan"])
def test_a_time_to_stop_after_that_is_none(folder: Path, tmp_path: Path, minutes: str) -> None:
    line = plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *TINY, "--stop-after", minutes))
    assert line.startswith("Error: Invalid value for '--stop-after': it must be greater than or equal to 0.")
    assert not (tmp_path / "run").exists()


def test_a_finished_run_whose_weights_are_gone(folder: Path, trained: Path, tmp_path: Path) -> None:
    shutil.copytree(trained, tmp_path / "run")
    (tmp_path / "run" / "best.pt").unlink()
    assert "There is no file of weights" in plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *TINY))


def test_a_checkpoint_of_another_architecture(folder: Path, trained: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (run / "checkpoint.pt").write_bytes((trained / "checkpoint.pt").read_bytes())
    settings = json.loads((trained / "run.json").read_text())
    settings["options"]["activation"] = "relu"
    settings["options"]["masks"] = False
    (run / "run.json").write_text(json.dumps(settings))
    before = content_of(run)
    line = plain_refusal(
        pavetwin("train", folder, "-o", run, *TINY, "--set", "activation=relu", "--set", "masks=false")
    )
    assert "is of another architecture" in line
    assert content_of(run) == before


def test_weights_of_another_architecture(folder: Path, trained: Path, tmp_path: Path) -> None:
    words = ("--start", trained / "best.pt", "--set", "activation=relu")
    line = plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *TINY, *words))
    assert "is of another architecture: activation silu, not relu" in line
    assert not (tmp_path / "run").exists()


def test_a_loss_that_is_not_a_number(folder: Path, tmp_path: Path) -> None:
    words = ("train", folder, "-o", tmp_path / "run", *TINY)
    assert pavetwin(*words, "--stop-after", 0).returncode == 0
    checkpoint = tmp_path / "run" / "checkpoint.pt"
    held = torch.load(checkpoint, weights_only=True)
    held["network"]["detection.classes.0.2.bias"].fill_(float("nan"))
    torch.save(held, checkpoint)
    before = content_of(tmp_path)
    done = pavetwin(*words)
    assert done.returncode == 2, done.stderr
    where, line = done.stderr.splitlines()
    assert "Training on cpu" in where
    assert line.startswith("Error: A loss is not finite (phase 'all', epoch 1, step 2: ")
    assert content_of(tmp_path) == before


@pytest.mark.parametrize("command", ["detect", "evaluate", "serve"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_damaged_onnx_file(folder: Path, tmp_path: Path, command: str, share: float) -> None:
    content = FILE.read_bytes()
    model = tmp_path / "model.onnx"
    model.write_bytes(content[: int(share * len(content))])
    words = {
        "detect": ("detect", folder / "images" / "val", "--model", model, "-o", tmp_path / "found"),
        "evaluate": ("evaluate", model, folder, "--split", "val", "-o", tmp_path / "report"),
        "serve": ("serve", "--model", model, "--port", 0),
    }[command]
    assert "model.onnx" in plain_refusal(pavetwin(*words))
    assert [path.name for path in tmp_path.iterdir()] == ["model.onnx"]
