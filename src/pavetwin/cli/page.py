"""`pavetwin app`: the page."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from pavetwin.cli.arguments import CacheFolder
from pavetwin.cli.console import out


def app(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[WORLD|STUDY|DATASET]…",
            help="Folders of worlds, those in worlds/ unless any is given; and of studies and datasets to look at.",
        ),
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0: for every machine.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="To listen at; 0 takes a free one.")] = 8765,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address, and open no browser.")] = False,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
) -> None:
    """Open a page to pick streets on a map, fly over them, and play what was flown.

    \b
    pavetwin app worlds/town
    pavetwin app worlds/town worlds/berlin --port 9000
    pavetwin app studies/first datasets/town
    pavetwin app worlds/town --host 0.0.0.0 --no-browser

    What the page flies is written where `pavetwin fly` writes it. Only this machine is answered unless --host says
    otherwise, and only who has the token in the printed address; there is no encryption.
    """
    from pavetwin.app.guard import Guard
    from pavetwin.app.server import serve_forever
    from pavetwin.app.session import Session
    from pavetwin.listening import run_until_terminated

    session, guard = Session.of(folders or ()), Guard(host)
    named = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else f"[{host}]" if ":" in host else host

    def tell(at: int) -> None:
        address = f"http://{named}:{at}/?token={guard.token}"
        out.line(f"The page is at {address}; Ctrl-C ends it.")
        sys.stdout.flush()  # whoever started it with a pipe waits for this line
        if not no_browser:
            import webbrowser

            webbrowser.open(address)

    if run_until_terminated(serve_forever(session, guard, host, port, tell)):
        raise typer.Exit(128 + signal.SIGTERM)
