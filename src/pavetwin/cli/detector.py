"""`pavetwin detect` and `pavetwin serve`: detections in images, as files or as a service for other programs."""

import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.options import DetectorOptions, Host, Port, check_empty, grouped
from pavetwin.errors import about
from pavetwin.files import check_folder
from pavetwin.reports.words import counted

if TYPE_CHECKING:
    from pavetwin.perception.detect_folder import DetectOutcome


@grouped
def detect(
    source: Annotated[Path, typer.Argument(help="An image, a video, or a folder of images.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")],
    detector: DetectorOptions,
    overlap: Annotated[float, typer.Option(help="IoU above which two boxes of a class count as one object.")] = 0.7,
    image_px: Annotated[
        int, typer.Option("--image", help="Side of the network's input, in pixels; 0: as it was trained.")
    ] = 0,
    gsd_mm: Annotated[
        float | None,
        typer.Option(
            help=(
                "Ground resolution of all images in millimetres per pixel, as in --gsd-mm 2.7; default: from the "
                "metadata of photographs."
            )
        ),
    ] = None,
    every_s: Annotated[
        float,
        typer.Option("--every", metavar="SECONDS", help="Interval between frames of a video; 0: every frame."),
    ] = 1.0,
    pictures: Annotated[bool, typer.Option(help="Write annotated images.")] = True,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Find defects, persons and cars in images: annotated images, and files for other programs.

    \b
    pavetwin detect pictures -o found --model photographs
    pavetwin detect flight.mp4 --model model.onnx -o found --every 0.5
    pavetwin detect street.jpg --model model.onnx -o found --tiled --gsd-mm 2.7
    pavetwin detect pictures -o found --model photographs --overview

    Needs onnxruntime (`pip install pavetwin\\[detect]`), and no PyTorch.
    """
    file = detector.file
    with about("output"):
        check_folder(output)
    check_empty(output, force=force)
    from pavetwin.perception.detect_folder import detect_source
    from pavetwin.perception.detector import Detector

    network = Detector(
        file,
        confidence=detector.confidence,
        overlap=overlap,
        tiled=detector.tiled,
        overview=detector.overview,
        image_px=image_px,
    )
    with progress("Detecting", lines=True) as show:
        outcome = detect_source(network, source, output, every_s=every_s, gsd_mm=gsd_mm, pictures=pictures, report=show)
    _print_outcome(outcome, output, pictures=pictures)


def _print_outcome(outcome: "DetectOutcome", output: Path, *, pictures: bool) -> None:
    from collections import Counter

    from pavetwin.labels.class_names import CLASSES, display_name

    found = Counter(name for image in outcome.images for name in image.detections.class_name)
    parts = ", ".join(f"{display_name(name)} {found[name]}" for name in CLASSES if found[name])
    images = counted(len(outcome.images), "image")
    out.line(f"{images}, {counted(found.total(), 'detection')}{': ' + parts if parts else ''}.")
    if outcome.unreadable:
        count = counted(len(outcome.unreadable), "unreadable file")
        out.line(f"Left out: {count}, such as {outcome.unreadable[0]}")
    names = ", ".join(file.name for file in outcome.files)
    out.line(f"Results: {output} ({names}{', pictures/' if pictures else ''})")


@grouped
def serve(
    detector: DetectorOptions,
    host: Host = "127.0.0.1",
    port: Port = 5000,
    upload_mb: Annotated[float, typer.Option("--max-mb", help="Largest size of a request, in megabytes.")] = 32.0,
    megapixels: Annotated[float, typer.Option("--max-megapixels", help="Largest size of an image.")] = 50.0,
) -> None:
    """Answer requests with detections: POST /predict and /predict/batch, GET /health, and a page of help at /.

    \b
    pavetwin serve
    curl -F file=@street.jpg http://127.0.0.1:5000/predict

    Only this machine can connect unless --host opens it to others; there is no password and no encryption.
    """
    file = detector.file
    from pavetwin.listening import run_until_terminated
    from pavetwin.perception.detector import Detector
    from pavetwin.perception.server import PredictionServer, serve_forever
    from pavetwin.perception.uploads import ServerLimits

    limits = ServerLimits(upload_mb=upload_mb, megapixels=megapixels)
    network = Detector(file, confidence=detector.confidence, tiled=detector.tiled, overview=detector.overview)
    server = PredictionServer(network, file.name, limits)
    name = f"[{host}]" if ":" in host else host

    def print_address(bound: int) -> None:
        out.line(f"Listening at http://{name}:{bound}/, where a page explains the requests; Ctrl-C stops it.")
        sys.stdout.flush()  # a caller with a pipe waits for this line

    if run_until_terminated(serve_forever(server, host, port, print_address)):
        raise typer.Exit(128 + signal.SIGTERM)
