"""`pavetwin serve`: the detector as a service for other programs."""

import signal
import sys
from typing import Annotated

import typer

from pavetwin.cli.console import out
from pavetwin.cli.detect import Model, Overview, named


def serve(
    model: Model = None,
    host: Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0: for every machine.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="To listen at; 0 takes a free one.")] = 5000,
    confidence: Annotated[float, typer.Option(help="The least confidence of what is said.")] = 0.25,
    tiled: Annotated[
        bool | None, typer.Option("--tiled/--whole", help="As of `detect`; unless given, as the model was trained.")
    ] = None,
    overview: Overview = False,
    upload_mb: Annotated[float, typer.Option("--max-mb", help="Of one request.")] = 32.0,
    megapixels: Annotated[float, typer.Option("--max-megapixels", help="Of one image.")] = 50.0,
) -> None:
    """Answer requests with detections: POST /predict and /predict/batch, GET /health, a page about them at /.

    \b
    pavetwin serve
    curl -F file=@street.jpg http://127.0.0.1:5000/predict

    Only this machine is answered unless --host says otherwise; there is no password and no encryption.
    """
    path = named(model)
    from pavetwin.listening import run_until_terminated
    from pavetwin.perception.inference import Detector
    from pavetwin.perception.serving.server import PredictionServer, serve_forever
    from pavetwin.perception.serving.uploads import ServerLimits

    limits = ServerLimits(upload_mb=upload_mb, megapixels=megapixels)
    detector = Detector(path, confidence=confidence, tiled=tiled, overview=overview)
    server = PredictionServer(detector, path.name, limits)
    shown = f"[{host}]" if ":" in host else host

    def tell(at: int) -> None:
        out.line(f"Listening at http://{shown}:{at}/, which says how to ask; Ctrl-C ends it.")
        sys.stdout.flush()  # whoever started it with a pipe waits for this line

    if run_until_terminated(serve_forever(server, host, port, tell)):
        raise typer.Exit(128 + signal.SIGTERM)
