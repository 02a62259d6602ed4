"""`pavetwin detect`: detections of pictures, folders and videos, from a model file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError, about
from pavetwin.files import check_folder
from pavetwin.perception.shipped import DEFAULT

if TYPE_CHECKING:
    from pavetwin.perception.results.detect_folder import DetectOutcome

Model = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="NAME|FILE.onnx",
        help=f"A file of `pavetwin export`, or a detector that ships: {DEFAULT} (default), or photographs.",
    ),
]

Overview = Annotated[
    bool,
    typer.Option(
        "--overview",
        help="Look at images that are larger than what the network was trained on in tiles and as a whole too: finds "
        "more, and takes up to five times as long for small ones, a twentieth longer for large ones.",
    ),
]


def named(model: str | None) -> Path:
    """The file of a model: the default one where none is named.

    Raises:
        PaveTwinError: there is none.
    """
    from pavetwin.perception.shipped import model_path

    try:
        return model_path(model or DEFAULT)
    except PaveTwinError as error:
        raise PaveTwinError(f"`model`: {error}") from error


def detect(
    source: Annotated[Path, typer.Argument(help="A picture, a video, or a folder of pictures.")],
    model: Model = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the results.")] = None,
    confidence: Annotated[float, typer.Option(help="The least confidence of what is said.")] = 0.25,
    overlap: Annotated[float, typer.Option(help="IoU from which two boxes of a kind are one object.")] = 0.7,
    tiled: Annotated[
        bool | None,
        typer.Option(
            "--tiled/--whole",
            help="Look at large images in tiles at their own resolution, or scaled down as a whole; unless given, as "
            "the model was trained.",
        ),
    ] = None,
    overview: Overview = False,
    image: Annotated[int, typer.Option(help="Side of what the network sees, in pixels; 0: as it was trained.")] = 0,
    gsd_mm: Annotated[
        float | None,
        typer.Option(help="Ground resolution of all pictures, as in --gsd-mm 2.7; else as photographs say."),
    ] = None,
    every: Annotated[float, typer.Option(metavar="SECONDS", help="Between frames of a video; 0: every frame.")] = 1.0,
    pictures: Annotated[bool, typer.Option(help="Write annotated pictures.")] = True,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that holds something.")] = False,
) -> None:
    """Find defects, persons and cars in pictures: annotated pictures, and files for other programs.

    \b
    pavetwin detect pictures -o found --model photographs
    pavetwin detect flight.mp4 --model model.onnx -o found --every 0.5
    pavetwin detect street.jpg --model model.onnx -o found --tiled --gsd-mm 2.7
    pavetwin detect pictures -o found --model photographs --overview

    Needs onnxruntime (`pip install pavetwin\\[detect]`), and no PyTorch.
    """
    path = named(model)
    if output is None:
        raise PaveTwinError("Say where the results go with -o, for example -o found.")
    with about("output"):
        check_folder(output)
    if output.exists() and any(output.iterdir()) and not force:
        raise PaveTwinError(f"`output` '{output}' exists and holds something; choose another folder, or add `force`.")
    from pavetwin.perception.inference import Detector
    from pavetwin.perception.results.detect_folder import detect_source

    detector = Detector(path, confidence=confidence, overlap=overlap, tiled=tiled, overview=overview, image_px=image)
    with progress("Detecting", lines=True) as tell:
        outcome = detect_source(detector, source, output, every_s=every, gsd_mm=gsd_mm, pictures=pictures, tell=tell)
    _tell(outcome, output, pictures=pictures)


def _tell(outcome: "DetectOutcome", output: Path, *, pictures: bool) -> None:
    from collections import Counter

    from pavetwin.perception.classes import CLASSES
    from pavetwin.reports.words import counted

    found = Counter(thing.name for image in outcome.images for thing in image.things)
    parts = ", ".join(f"{name} {found[name]}" for name in CLASSES if found[name])
    images = counted(len(outcome.images), "image")
    out.line(f"{images}, {counted(found.total(), 'detection')}{': ' + parts if parts else ''}.")
    if outcome.unreadable:
        count = counted(len(outcome.unreadable), "file")
        out.line(f"Left out: {count} that cannot be read, such as this: {outcome.unreadable[0]}")
    names = ", ".join(file.name for file in outcome.files)
    out.line(f"Results: {output} ({names}{', pictures/' if pictures else ''})")
