"""`pavetwin train`: from a dataset to weights, live curves, and plain refusals."""

import json
import shutil
from io import StringIO
from pathlib import Path

import pytest
import torch
from rich.console import Console
from rich.live import Live

from pavetwin.cli.train import LiveCurves, curves_table, sparkline
from pavetwin.training.trainer.run_folder import RunFolder, load_network
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_detector import FILE
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

TINY = ("--image", 64, "--epochs", 1, "--batch", 4, "--device", "cpu", "--set", "width=0.03", "--set", "depth=0.01")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn_roads(tmp_path_factory.mktemp("roads"), {"train": 12, "val": 3}, size=(64, 48))


def test_a_packed_dataset_is_trained_from_in_chunks(folder: Path, tmp_path: Path) -> None:
    assert pavetwin("data", "pack", folder, "-o", tmp_path / "r.pack").returncode == 0
    words = ("train", tmp_path / "r.pack", "-o", tmp_path / "run", *TINY, "--set", "classifier_epochs=1")
    first = pavetwin(*words, "--stop-after", 0)
    assert first.returncode == 0, first.stderr
    assert first.stdout == f"Stopped on time; the same command continues {tmp_path / 'run'}/.\n"
    done = pavetwin(*words)
    assert done.returncode == 0, done.stderr
    assert "Trained: " in done.stdout
    assert "all: epoch 1, loss " in done.stderr
    assert len((tmp_path / "run" / "curves.csv").read_text().splitlines()) == 3


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--size", "xl"), "--size: no size 'xl' (did you mean 'l'?); known are n, s, m, l."),
        (("--order", "reel"), "--order: no order 'reel' (did you mean 'real'?)"),
        (("--order", "synthetic"), "--order synthetic: the datasets have no synthetic images to train on."),
        (("--image", 100), "--image 100: it must be a multiple of 32."),
        (("--set", "epoch=3"), "--set: no setting 'epoch' (did you mean 'epochs'?)"),
        (("--start", "nosuch.pt"), "--start: there is no file of weights 'nosuch.pt'"),
        (("--device", "gpu"), "--device: 'gpu' cannot be used here."),
        (("--without", "Cars"), "--without: no class 'Cars' (did you mean 'Car'?)"),
    ],
)
def test_wrong_options_are_refused_by_name(folder: Path, tmp_path: Path, words: tuple[str, ...], told: str) -> None:
    line = plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *words))
    assert line.startswith(f"Error: {told}")
    assert not (tmp_path / "run").exists()


def test_the_curves_are_drawn() -> None:
    rows = [
        {
            "total": 9.0 - at,
            "box": 1.0,
            "classes": 2.0,
            "subtype": 0.0,
            "mask": 0.0,
            "map50": 0.1 * at,
            "map": 0.05 * at,
        }
        for at in range(5)
    ]
    console = Console(width=80, file=StringIO())
    console.print(curves_table(rows))
    text = console.file.getvalue()
    assert "loss          █▆▅▃▁  5.000  5.000" in text
    assert "mAP@0.5       ▁▃▅▆█  0.400  0.400" in text
    assert "mask" not in text
    assert sparkline([3.0]) == "▁"


def test_where_it_trains_stands_above_the_curves() -> None:
    console = Console(width=80, file=StringIO(), force_terminal=True)
    with Live(console=console, auto_refresh=False) as live:
        curves = LiveCurves(live)
        curves.on_start("Training on cpu.")
        curves.on_epoch([{"phase": "all", "epoch": 1, "total": 1.0, "map50": 0.5, "map": 0.25}])
    text = console.file.getvalue()
    assert 0 <= text.index("Training on cpu.") < text.rindex("mAP@0.5")


ONE_EPOCH = (
    *("--image", 64, "--epochs", 1, "--batch", 4, "--device", "cpu", "--set", "width=0.03", "--set", "depth=0.01"),
    *("--set", "classifier_epochs=0"),
)


@pytest.fixture(scope="module")
def trained(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "run"
    done = pavetwin("train", folder, "-o", run, *ONE_EPOCH)
    assert done.returncode == 0, done.stderr
    return run


def content_of(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_dataset_without_a_class(tmp_path: Path) -> None:
    names = ("Pothole", "Single Crack", "Car")
    drawn_roads(tmp_path / "roads", {"train": 9, "val": 2}, size=(64, 48), names=names)
    line = plain_refusal(pavetwin("train", tmp_path / "roads", "-o", tmp_path / "run", *ONE_EPOCH))
    assert line == (
        "Error: No training image shows a labelled Crocodile Crack, Person; add a dataset that has some, or leave them "
        "out (--without 'Crocodile Crack,Person')."
    )
    assert not (tmp_path / "run").exists()
    told = ("--without", "Crocodile Crack,Person")
    assert pavetwin("train", tmp_path / "roads", "-o", tmp_path / "run", *ONE_EPOCH, *told).returncode == 0


def test_a_run_of_other_settings(folder: Path, trained: Path) -> None:
    before = content_of(trained)
    line = plain_refusal(pavetwin("train", folder, "-o", trained, *ONE_EPOCH, "--set", "rate=0.5"))
    assert "holds a run with rate 0.001, not 0.5" in line
    assert content_of(trained) == before


def test_a_run_that_began_with_other_weights_of_the_same_name(folder: Path, trained: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        network, told = load_network(trained / "best.pt")
        with torch.no_grad():
            next(network.parameters()).add_(0.0 if name == "a" else 0.01)
        (tmp_path / name).mkdir()
        RunFolder(tmp_path / name).save_best(network, told)
    words = ("train", folder, "-o", tmp_path / "run", *ONE_EPOCH, "--start")
    assert pavetwin(*words, tmp_path / "a" / "best.pt").returncode == 0
    before = content_of(tmp_path / "run")
    line = plain_refusal(pavetwin(*words, tmp_path / "b" / "best.pt"))
    assert "holds a run with start_sha256" in line
    assert content_of(tmp_path / "run") == before


@pytest.mark.parametrize("minutes", ["-1", "nan"])
def test_a_time_to_stop_after_that_is_none(folder: Path, tmp_path: Path, minutes: str) -> None:
    line = plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *ONE_EPOCH, "--stop-after", minutes))
    assert line.startswith("Error: --stop-after: it must be greater than or equal to 0.")
    assert not (tmp_path / "run").exists()


def test_a_finished_run_whose_weights_are_gone(folder: Path, trained: Path, tmp_path: Path) -> None:
    shutil.copytree(trained, tmp_path / "run")
    (tmp_path / "run" / "best.pt").unlink()
    assert "There is no file of weights" in plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *ONE_EPOCH))


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
        pavetwin("train", folder, "-o", run, *ONE_EPOCH, "--set", "activation=relu", "--set", "masks=false")
    )
    assert "is of another architecture" in line
    assert content_of(run) == before


def test_weights_of_another_architecture(folder: Path, trained: Path, tmp_path: Path) -> None:
    words = ("--start", trained / "best.pt", "--set", "activation=relu")
    line = plain_refusal(pavetwin("train", folder, "-o", tmp_path / "run", *ONE_EPOCH, *words))
    assert "is of another architecture: activation silu, not relu" in line
    assert not (tmp_path / "run").exists()


def test_a_loss_that_is_not_a_number(folder: Path, tmp_path: Path) -> None:
    words = ("train", folder, "-o", tmp_path / "run", *ONE_EPOCH)
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
