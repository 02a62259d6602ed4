"""`pavetwin train`: from a dataset to weights, live curves, and plain refusals."""

from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from rich.live import Live

from pavetwin.cli.train import LiveCurves, curves_table, sparkline
from scenes.command_line import pavetwin, plain_refusal
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
