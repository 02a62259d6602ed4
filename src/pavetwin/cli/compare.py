"""`pavetwin compare`: compare models in one table."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from pavetwin.cli.console import out, progress, table
from pavetwin.cli.train import has_torch
from pavetwin.errors import PaveTwinError, about, no_such
from pavetwin.files import check_target, writing

EXPORT = ("onnx", "onnxscript")
"""Modules besides PyTorch that count operations and export untrained networks."""

SIZES = ("n", "s", "m", "l")


def compare(
    models: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME=]MODEL", help="Files of `pavetwin export`, or detectors that ship, by name."),
    ] = None,
    sizes: Annotated[
        str, typer.Option(help="Untrained networks to add, as in --sizes n,s,m,l: size, FPS and GFLOPs only.")
    ] = "",
    ultralytics: Annotated[
        str, typer.Option(help="Untrained networks of Ultralytics (AGPL-3.0), as in yolo11n,yolo12s, if installed.")
    ] = "",
    weights: Annotated[
        list[str] | None,
        typer.Option(metavar="[NAME=]FILE.pt", help="Weights trained with Ultralytics, if installed; repeatable."),
    ] = None,
    dataset: Annotated[
        Path | None, typer.Option(help="Dataset to measure accuracy on; without it, accuracy is left empty.")
    ] = None,
    split: Annotated[str, typer.Option(help="Split of the dataset: test, val or train.")] = "test",
    frames: Annotated[int, typer.Option(min=1, help="Number of frames that each model is timed on.")] = 30,
    threads: Annotated[int, typer.Option(min=0, help="Number of threads per image; 0: one per core.")] = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The table as a file, such as models.csv.")
    ] = None,
) -> None:
    """Compare models: accuracy on a dataset, size of the file, frames per second on this machine, operations.

    \b
    pavetwin compare --sizes n,s,m,l
    pavetwin compare small.onnx real=runs/real.onnx --dataset datasets/streets -o models.csv
    pavetwin compare photographs rendered --dataset datasets/streets
    pavetwin compare --sizes n,s --ultralytics yolov8n,yolo11n,yolo12n --weights eleven=runs/eleven/best.pt

    Cells without a measurement are empty. FPS: one image of 640 × 480, from pixels to detections, with the defaults
    of `detect`. GFLOPs: one image of 640 × 640. Needs onnxruntime (`pip install pavetwin\\[detect]`);
    untrained networks and GFLOPs need PyTorch too (`pavetwin\\[train]`), accuracy pycocotools
    (`pavetwin\\[evaluate]`). Ultralytics is not part of PaveTwin: it is AGPL-3.0, runs in PyTorch here, and its sizes
    are those of its parameters in single precision.
    """
    from pavetwin.labels import SPLITS

    files = [_named(each) for each in models or ()]
    wanted, others = ([each.strip() for each in text.split(",") if each.strip()] for text in (sizes, ultralytics))
    foreign: list[tuple[str, str | Path]] = [(each, each) for each in others]
    foreign += [_named(each) for each in weights or ()]
    for each in wanted:
        if each not in SIZES:
            raise PaveTwinError(no_such("size", each, SIZES, key="`sizes`"))
    if split not in SPLITS:
        raise PaveTwinError(no_such("split", split, SPLITS, key="`split`"))
    if not files and not wanted and not foreign:
        raise PaveTwinError("Name models to compare, or `sizes` of untrained networks, as in --sizes n,s,m,l.")
    if wanted and not has_torch(*EXPORT):
        raise PaveTwinError("Untrained networks need PyTorch, an extra; install it with `pip install pavetwin[train]`.")
    from pavetwin.perception.model_file import check_threads
    from pavetwin.training.evaluation.comparison import (
        HEADINGS,
        ComparedModel,
        as_csv,
        cells,
        compared,
        compared_ultralytics,
        processor,
        with_speeds,
    )
    from pavetwin.training.evaluation.labelled import read_split
    from pavetwin.training.evaluation.ultralytics_models import LICENCE, check_ultralytics

    check_threads(threads)
    if output is not None:
        with about("output"):
            check_target(output)
    for _, network in foreign:
        check_ultralytics(network)
    if foreign and not has_torch(*EXPORT):
        raise PaveTwinError("GFLOPs need PyTorch and onnx, an extra; install it with `pip install pavetwin[train]`.")
    if foreign:
        out.line(f"{LICENCE}\n")

    labels = None
    if dataset is not None:
        with about("dataset"):
            labels = read_split(dataset, split)
    rows: list[ComparedModel] = []
    count = None
    total = len(files) + len(wanted) + len(foreign)
    if has_torch(*EXPORT):
        from pavetwin.training.trainer.export import export_untrained, gflops_of

        count = gflops_of
    with TemporaryDirectory() as folder, progress("Comparing") as report:
        for name, path in files:
            rows.append(compared(name, path, split=labels, frames=frames, threads=threads, count=count))
            report(len(rows) / total)
        for size in wanted:
            path = Path(folder) / f"{size}.onnx"
            export_untrained(size, path)
            name = f"{size}, untrained"
            rows.append(compared(name, path, split=None, frames=frames, threads=threads, count=count))
            report(len(rows) / total)
        for name, given in foreign:
            from pavetwin.training.network.network import gflops

            title = name if isinstance(given, Path) else f"{name}, untrained"
            row = compared_ultralytics(title, given, split=labels, frames=frames, threads=threads, count=gflops)
            rows.append(row)
            report(len(rows) / total)
    rows = with_speeds(rows, "n, untrained")
    shown = table(*HEADINGS)
    for row in rows:
        shown.add_row(*cells(row))
    out.print(shown)
    out.line(f"\nFPS on {processor()}, {threads or os.cpu_count()} threads.")
    if output is not None:
        with writing(output) as temporary:
            temporary.write_text(as_csv(rows), encoding="utf-8")
        out.line(f"Table: {output}")


def _named(given: str) -> tuple[str, Path]:
    name, equals, path = given.rpartition("=")
    return (name if equals and name else Path(path).stem), Path(path)
