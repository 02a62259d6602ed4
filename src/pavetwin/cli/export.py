"""`pavetwin export`: a trained detector as one ONNX file."""

from pathlib import Path
from typing import Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError, about
from pavetwin.files import check_target, writing
from pavetwin.perception.shipped import model_path, shipped_models


def export(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN",
            help="Folder of a run, or its best.pt; several that began with the same weights give the mean of theirs. "
            "Or an exported model, or one that ships, to store it otherwise.",
        ),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file, such as model.onnx.")] = None,
    half: Annotated[
        bool, typer.Option("--half", help="Store the weights in half precision: half the size, the same speed.")
    ] = False,
    int8: Annotated[
        Path | None,
        typer.Option(metavar="PICTURES", help="Convolutions in int8, with ranges from a folder of pictures: smaller."),
    ] = None,
    licence: Annotated[
        str,
        typer.Option(help="Of the weights, as the file shall say it, such as Apache-2.0; a model keeps its own."),
    ] = "",
) -> None:
    """Write a trained detector as one ONNX file, which runs without PyTorch.

    \b
    pavetwin export runs/first -o model.onnx
    pavetwin export runs/first/best.pt -o small.onnx --half --licence Apache-2.0
    pavetwin export runs/first -o int8.onnx --int8 datasets/town/images/train
    pavetwin export synthetic-11 -o int8.onnx --int8 datasets/town/images/train
    pavetwin export runs/seed-0 runs/seed-1 runs/seed-2 -o mean.onnx --half

    Needs PyTorch (`pip install pavetwin\\[train]`); `pavetwin detect` and `pavetwin serve` run the file without it.
    """
    if output is None:
        raise PaveTwinError("Say where the model goes with -o, for example -o model.onnx.")
    with about("output"):
        check_target(output)
    if output.suffix.lower() != ".onnx":
        raise PaveTwinError(f"`output` '{output}': a model's name ends in .onnx, by which other commands know it.")
    if int8 is not None and half:
        raise PaveTwinError("`int8`: weights are stored in int8 or in half precision; leave `half` out.")
    if int8 is not None and not int8.is_dir():
        raise PaveTwinError(f"`int8`: there is no folder of pictures '{int8}'.")
    runs = [_existing(run) for run in runs]
    _check_installed()
    from pavetwin.training.trainer.export import export as exported

    with progress("Exporting"):
        if int8 is None:
            facts = exported(runs, output, licence=licence, half=half)
        else:
            from pavetwin.training.trainer.quantise import pictures_in, store_in_int8

            pictures = pictures_in(int8)
            with writing(output) as temporary:
                facts = exported(runs, temporary, licence=licence)
                store_in_int8(temporary, pictures)
    masks = "with masks" if facts.mask_px else "without masks"
    of = f" the mean of {len(runs)} runs," if len(runs) > 1 else ""
    out.line(f"Model: {output},{of} {output.stat().st_size / 1e6:.1f} MB, {masks}, for images of {facts.image_px} px.")


def _existing(run: Path) -> Path:
    """A run, weights, an exported model, or the file of one that ships."""
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
