"""`pavetwin train` and `pavetwin export`: train the detector, and write it as one ONNX file."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Group
from rich.progress_bar import ProgressBar
from rich.table import Table

from pavetwin.cli.console import err, out, progress
from pavetwin.errors import PaveTwinError, about, naming
from pavetwin.files import check_target
from pavetwin.perception.model_file import model_path, shipped_models

if TYPE_CHECKING:
    from rich.live import Live

    from pavetwin.training.trainer.run_folder import Curves
    from pavetwin.training.trainer.schedule import Phase
    from pavetwin.training.trainer.trainer import Watcher


def train(
    datasets: Annotated[list[Path], typer.Argument(help="Folders with COCO files, or packed files (`data pack`).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the run.")],
    size: Annotated[str | None, typer.Option(help="n (default), s, m or l.")] = None,
    image: Annotated[int | None, typer.Option(help="Side of images in pixels; default: 640.")] = None,
    native: Annotated[
        bool, typer.Option("--native", help="Crop larger images at native resolution, which keeps thin cracks visible.")
    ] = False,
    order: Annotated[
        str | None,
        typer.Option(help="real-synthetic (default), synthetic-real, mixed, real or synthetic."),
    ] = None,
    epochs: Annotated[int | None, typer.Option(help="Epochs of the detector in each stage; default: 40.")] = None,
    batch: Annotated[int | None, typer.Option(help="Images per step; default: 16.")] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; default: 0.")] = None,
    without: Annotated[
        str | None, typer.Option(help="Classes that may be missing from the data, as in --without Person,Car.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Another setting, as in --set width=0.125; repeatable."),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(help="Initial weights: best.pt of a run, an exported model, or a detector that ships, by name."),
    ] = None,
    stop_after: Annotated[
        float | None,
        typer.Option(metavar="MINUTES", min=0, help="Save and stop after this time; run again to continue."),
    ] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda; default: a graphics card if there is one.")] = "",
    workers: Annotated[int, typer.Option(min=0, help="Processes that prepare images.")] = 0,
    held_gb: Annotated[
        float, typer.Option(metavar="GB", min=0, help="Decoded images of each dataset kept in memory.")
    ] = 2.0,
    views: Annotated[
        str,
        typer.Option(help="Where views are drawn: processor or device; default: a graphics card with enough memory."),
    ] = "",
    compiled: Annotated[
        bool, typer.Option("--compile", help="Compile the network first, which takes a minute or more.")
    ] = False,
) -> None:
    """Train the detector on labelled images, or continue a stopped run.

    \b
    pavetwin train datasets/china datasets/town -o runs/first
    pavetwin train datasets/china -o runs/real --size s --without Person,Car
    pavetwin train datasets/mine -o runs/mine --start photographs --image 512 --native --without Person,Car
    pavetwin train datasets.pack -o runs/small --image 320 --native --set width=0.125 --stop-after 9

    Needs PyTorch (`pip install pavetwin\\[train]`). The same settings, data and hardware give the same weights.
    """
    from pavetwin.perception.model_file import start_path
    from pavetwin.training.datasets.packs import read_examples
    from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions

    given: dict[str, Any] = {"size": size, "image_px": image, "order": order, "epochs": epochs, "batch": batch}
    given |= {"seed": seed, "without": without, "native": native or None}
    pairs = [f"{name}={value}" for name, value in given.items() if value is not None]
    with naming({"`image_px`": "`image`"}):
        options = TrainingOptions.parse([*pairs, *(overrides or [])])
    machine = TrainingMachine(device, workers, held_gb, views, compiled)
    begun = start_path(start) if start is not None else None
    check_torch("Training")
    from pavetwin.training.trainer.trainer import Trainer

    with _watched() as watcher:
        trainer = Trainer(read_examples(datasets), output, options, machine, watcher, begun)
        finished = trainer.run(60 * stop_after if stop_after is not None else None)
    if not finished:
        out.line(f"Stopped on time; the same command continues {output}/.")
        return
    where = quote(str(output / "best.pt"))
    out.line(f"Trained: {where}, mAP@0.5 {trainer.best_map50:.3f} on the validation images.")


def has_torch(*more: str) -> bool:
    """Whether PyTorch and the modules `more` of its extra are installed."""
    from importlib.util import find_spec

    return all(find_spec(name) is not None for name in ("torch", "torchvision", *more))


def check_torch(what: str, *more: str) -> None:
    """Raises:
    PaveTwinError: PyTorch, or one of the modules `more` of its extra, is not installed.
    """
    if not has_torch(*more):
        raise PaveTwinError(f"{what} needs PyTorch, which is an extra; install it with `pip install pavetwin[train]`.")


@contextmanager
def _watched() -> Iterator["Watcher"]:
    """Watcher with live curves on a terminal, and plain lines elsewhere."""
    if not err.rich.is_terminal:
        from pavetwin.training.trainer.trainer import PlainLines

        yield PlainLines()
        return
    from rich.live import Live

    with Live(console=err.rich, refresh_per_second=4) as live:
        yield LiveCurves(live)


SHOWN: Final = (
    ("total", "loss"),
    ("box", "box"),
    ("classes", "classes"),
    ("subtype", "subtype"),
    ("mask", "mask"),
    ("map50", "mAP@0.5"),
    ("map", "mAP@0.5:0.95"),
)
"""Columns of the curves and their display names."""

BLOCKS: Final = "▁▂▃▄▅▆▇█"
WIDTH: Final = 48
"""Number of last epochs in a line."""

STEP_S: Final = 0.2
"""Seconds between two updates within an epoch."""


class LiveCurves:
    """Watcher with a line for each loss and precision, and a progress bar of the epoch."""

    def __init__(self, live: "Live") -> None:
        self._live = live
        self._curves: Curves = []
        self._drawn_s = 0.0

    def on_start(self, where: str) -> None:
        self._live.console.print(where, highlight=False)

    def on_step(self, phase: "Phase", epoch: int, step: int, steps: int, total: float) -> None:
        now = time.monotonic()
        if now > self._drawn_s + STEP_S:
            self._drawn_s = now
            head = f"{phase.name}: epoch {epoch + 1} of {phase.epochs}, step {step} of {steps}, loss {total:.3f}"
            bar = ProgressBar(total=steps, completed=step, width=WIDTH)
            self._live.update(Group(head, bar, curves_table(self._curves)))

    def on_epoch(self, curves: "Curves") -> None:
        self._curves = list(curves)
        self._live.update(curves_table(self._curves))


def curves_table(curves: "Curves") -> Table:
    """Table with shape, last value and best value of each curve."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column(f"{len(curves)} epochs")
    table.add_column("", no_wrap=True)
    table.add_column("now", justify="right")
    table.add_column("best", justify="right")
    for key, name in SHOWN:
        values = [float(row.get(key) or 0) for row in curves]
        if any(values):
            best = max(values) if key.startswith("map") else min(value for value in values if value)
            table.add_row(name, sparkline(values[-WIDTH:]), f"{values[-1]:.3f}", f"{best:.3f}")
    return table


def sparkline(values: list[float]) -> str:
    """A curve as one line of blocks, scaled from its minimum to its maximum."""
    low, high = min(values), max(values)
    steps = len(BLOCKS) - 1
    return "".join(BLOCKS[round(steps * (value - low) / (high - low)) if high > low else 0] for value in values)


def export(
    run: Annotated[
        Path,
        typer.Argument(help="Folder of a run, its best.pt, an exported model, or a detector that ships, by name."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The file, such as model.onnx.")],
    half: Annotated[
        bool, typer.Option("--half", help="Store the weights in half precision: half the size, the same speed.")
    ] = False,
    licence: Annotated[
        str,
        typer.Option(
            help="Licence of the weights, stated in the file, such as Apache-2.0; default: that of an exported model."
        ),
    ] = "",
) -> None:
    """Write a trained detector as one ONNX file, which runs without PyTorch.

    \b
    pavetwin export runs/first -o model.onnx
    pavetwin export runs/first/best.pt -o small.onnx --half --licence Apache-2.0

    Needs PyTorch (`pip install pavetwin\\[train]`); `pavetwin detect` and `pavetwin serve` run the file without it.
    """
    with about("output"):
        check_target(output)
    if output.suffix.lower() != ".onnx":
        raise PaveTwinError(f"`output` '{output}': the name of a model ends in .onnx.")
    run = _existing(run)
    check_torch("Exporting", "onnx", "onnxscript")
    from pavetwin.training.trainer.export import export as exported

    with progress("Exporting"):
        facts = exported(run, output, licence=licence, half=half)
    masks = "with masks" if facts.mask_px else "without masks"
    out.line(f"Model: {output}, {output.stat().st_size / 1e6:.1f} MB, {masks}, for images of {facts.image_px} px.")


def _existing(run: Path) -> Path:
    """A run, weights, an exported model, or the file of a detector that ships."""
    if run.exists():
        return run
    if str(run) in shipped_models():
        return model_path(run)
    raise PaveTwinError(
        f"There is no run '{run}', and no model of this name ships ({', '.join(shipped_models())}); "
        "`pavetwin train` makes a run."
    )
