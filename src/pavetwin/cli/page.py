"""`pavetwin app`: the page."""

import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.arguments import CacheFolder
from pavetwin.cli.console import out

if TYPE_CHECKING:
    from pavetwin.app.task_pool import TaskPool


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
    from pavetwin.listening import run_until_terminated

    if run_until_terminated(_serve(folders or (), host, port, opens_browser=not no_browser)):
        raise typer.Exit(128 + signal.SIGTERM)


async def _serve(folders: Sequence[Path], host: str, port: int, *, opens_browser: bool) -> None:
    """The process that reads the first town is started before the server is loaded: it has the more to load."""
    from pavetwin.app.task_pool import TaskPool

    tasks = TaskPool()
    try:
        await tasks.warm_up()
        await _serve_with(tasks, folders, host, port, opens_browser=opens_browser)
    finally:
        await tasks.close()


async def _serve_with(tasks: "TaskPool", folders: Sequence[Path], host: str, port: int, *, opens_browser: bool) -> None:
    from pavetwin.app.addresses import name_for_others, own_name
    from pavetwin.app.guard import Guard
    from pavetwin.app.server import serve_forever
    from pavetwin.app.session import Session

    session, guard = Session.of(folders, tasks), Guard(host)

    def tell(at: int) -> None:
        address = f"http://{own_name(host)}:{at}/?token={guard.token}"
        out.line(f"The page is at {address}; Ctrl-C ends it.")
        if name := name_for_others(host):
            out.line(f"Other machines open http://{name}:{at}/?token={guard.token}")
        sys.stdout.flush()  # whoever started it with a pipe waits for this line
        if opens_browser:
            import webbrowser

            webbrowser.open(address)

    await serve_forever(session, guard, host, port, tell)
