"""`pavetwin compare`: models side by side."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError, about, no_such

SIZES = ("n", "s", "m", "l")


def compare(
    models: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME=]MODEL.onnx", help="Files of `pavetwin export`.")
    ] = None,
    sizes: Annotated[
        str, typer.Option(help="Untrained networks beside them, as in --sizes n,s,m,l: size, FPS and GFLOPs only.")
    ] = "",
    dataset: Annotated[Path | None, typer.Option(help="What accuracy is measured on; none without it.")] = None,
    split: Annotated[str, typer.Option(help="Of the dataset: test, val or train.")] = "test",
    frames: Annotated[int, typer.Option(min=1, help="How many are timed for each model.")] = 30,
    threads: Annotated[int, typer.Option(min=0, help="Of one image; 0: one for each core.")] = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The table as a file, such as models.csv.")
    ] = None,
) -> None:
    """Compare models: accuracy on a dataset, size of the file, frames a second on this machine, operations.

    \b
    pavetwin compare --sizes n,s,m,l
    pavetwin compare small.onnx real=runs/real.onnx --dataset datasets/streets -o models.csv

    A cell that was not measured is empty. FPS: one image of 640 × 480, from pixels to detections. GFLOPs: one image of
    640 × 640. Needs onnxruntime (`pip install pavetwin\\[detect]`); untrained networks and GFLOPs need PyTorch too
    (`pavetwin\\[train]`), accuracy pycocotools (`pavetwin\\[evaluate]`).
    """
    from pavetwin.labels import SPLITS

    files = [_named(each) for each in models or ()]
    wanted = [each.strip() for each in sizes.split(",") if each.strip()]
    for each in wanted:
        if each not in SIZES:
            raise PaveTwinError(no_such("size", each, SIZES, key="`sizes`"))
    if split not in SPLITS:
        raise PaveTwinError(no_such("split", split, SPLITS, key="`split`"))
    if not files and not wanted:
        raise PaveTwinError("Name models to compare, or `sizes` of untrained networks, as in --sizes n,s,m,l.")
    if wanted and not _has_torch():
        raise PaveTwinError("Untrained networks need PyTorch, an extra; install it with `pip install pavetwin[train]`.")
    from pavetwin.perception.evaluation.comparison import HEADINGS, ComparedModel, as_csv, cells, compared
    from pavetwin.perception.evaluation.labelled import read_split

    labels = None
    if dataset is not None:
        with about("dataset"):
            labels = read_split(dataset, split)
    rows: list[ComparedModel] = []
    count = None
    if _has_torch():
        from pavetwin.perception.training.untrained import export_untrained, gflops_of

        count = gflops_of
    with TemporaryDirectory() as folder, progress("Comparing") as tell:
        for name, path in files:
            rows.append(compared(name, path, split=labels, frames=frames, threads=threads, count=count))
            tell(len(rows) / (len(files) + len(wanted)))
        for size in wanted:
            path = Path(folder) / f"{size}.onnx"
            export_untrained(size, path)
            name = f"{size}, untrained"
            rows.append(compared(name, path, split=None, frames=frames, threads=threads, count=count))
            tell(len(rows) / (len(files) + len(wanted)))
    _tell(HEADINGS, [cells(row) for row in rows])
    if output is not None:
        from pavetwin.files import writing

        with writing(output) as temporary:
            temporary.write_text(as_csv(rows), encoding="utf-8")
        out.line(f"Table: {output}")


def _named(given: str) -> tuple[str, Path]:
    name, equals, path = given.rpartition("=")
    return (name if equals and name else Path(path).stem), Path(path)


def _has_torch() -> bool:
    from importlib.util import find_spec

    return all(find_spec(name) is not None for name in ("torch", "torchvision", "onnx", "onnxscript"))


def _tell(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for at, heading in enumerate(headings):
        table.add_column(heading, justify="right" if at else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    out.print(table)
