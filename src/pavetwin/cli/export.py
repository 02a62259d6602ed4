"""`pavetwin export`: a trained detector as one ONNX file."""

from pathlib import Path
from typing import Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError, about
from pavetwin.files import check_target
from pavetwin.perception.model_file import model_path, shipped_models


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
            help="Licence of the weights to be stated in the file, such as Apache-2.0; default: that of a model."
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
    _check_installed()
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


def _check_installed() -> None:
    from importlib.util import find_spec

    if any(find_spec(name) is None for name in ("torch", "torchvision", "onnx", "onnxscript")):
        raise PaveTwinError(
            "Exporting needs PyTorch and onnx, which are an extra; install them with `pip install pavetwin[train]`."
        )
