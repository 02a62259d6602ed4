"""`pavetwin app` and `pavetwin replay`: missions in a browser, from a server or as one file."""

import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.options import CacheFolder, Host, Port
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.app.task_pool import TaskPool


def app(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[WORLD|STUDY|DATASET]…",
            help="Folders of worlds (default: those in worlds/), and of studies and datasets to show.",
        ),
    ] = None,
    host: Host = "127.0.0.1",
    port: Port = 8765,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the address.")] = False,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
) -> None:
    """Open a page to select streets on a map, fly over them, and play missions.

    \b
    pavetwin app worlds/town
    pavetwin app worlds/town worlds/berlin --port 9000
    pavetwin app studies/first datasets/town
    pavetwin app worlds/town --host 0.0.0.0 --no-browser

    The page writes missions where `pavetwin fly` writes them. Only this machine can connect unless --host opens the
    page to others, and only with the token in the printed address; there is no encryption.
    """
    from pavetwin.listening import run_until_terminated

    if run_until_terminated(_serve(folders or (), host, port, opens_browser=not no_browser)):
        raise typer.Exit(128 + signal.SIGTERM)


async def _serve(folders: Sequence[Path], host: str, port: int, *, opens_browser: bool) -> None:
    """Serve the page. The process that reads the first town starts before the server is imported, since it imports
    more."""
    from pavetwin.app.task_pool import TaskPool

    tasks = TaskPool()
    try:
        await tasks.warm_up()
        await _serve_with(tasks, folders, host, port, opens_browser=opens_browser)
    finally:
        await tasks.close()


async def _serve_with(tasks: "TaskPool", folders: Sequence[Path], host: str, port: int, *, opens_browser: bool) -> None:
    from pavetwin.app.guard import Guard, name_for_others, own_name
    from pavetwin.app.server import serve_forever
    from pavetwin.app.session import Session

    session, guard = Session.of(folders, tasks), Guard(host)

    def print_address(bound: int) -> None:
        address = f"http://{own_name(host)}:{bound}/?token={guard.token}"
        out.line(f"The page is at {address}; Ctrl-C stops it.")
        if name := name_for_others(host):
            out.line(f"Other machines open http://{name}:{bound}/?token={guard.token}")
        sys.stdout.flush()  # a caller with a pipe waits for this line
        if opens_browser:
            import webbrowser

            webbrowser.open(address)

    await serve_forever(session, guard, host, port, print_address)


SUFFIXES = (".html", ".rrd")


def replay(
    folder: Annotated[
        Path,
        typer.Argument(metavar="MISSION", help="Folder of a mission, or of missions under several policies."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A .html file (default: replay.html in the folder), or .rrd for Rerun, if installed.",
        ),
    ] = None,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
) -> None:
    """Write a mission as one HTML file that plays in any browser, without a server or a network.

    \b
    pavetwin replay worlds/town/missions/hover-los-C-1-10m-default-seed1
    pavetwin replay missions/monday -o monday.html
    pavetwin replay missions/monday -o monday.rrd

    This flies the mission again for its traffic. A recording (.rrd) needs `pip install rerun-sdk`.
    """
    target = output or folder / "replay.html"
    if target.suffix not in SUFFIXES:
        raise PaveTwinError(f"`output` '{target}': name a file that ends in {' or '.join(SUFFIXES)}.")
    if target.is_dir():
        raise PaveTwinError(f"`output` '{target}' is a folder; name a file.")

    from pavetwin.app.exports import check_installed, replay_page, write_rerun
    from pavetwin.app.flights import again, descriptions, write_played
    from pavetwin.app.street_map import packed_map
    from pavetwin.files import writing
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import world_of

    files = descriptions(folder)
    if not files:
        raise PaveTwinError(f"'{folder}' holds no mission.yaml; name the folder of a mission.")
    if target.suffix == ".rrd":
        check_installed()
    formers = [MissionFolder(file) for file in files]
    world = world_of(formers[0].spec.world)
    with progress("Flying it again") as show:
        results, inputs = again(files, world, show)
        if target.suffix == ".rrd":
            write_rerun(results, target)
        else:
            with tempfile.TemporaryDirectory() as made:
                played = Path(made)
                write_played(results, inputs, played)
                town = played / "town.json"
                town.write_bytes(packed_map(world))
                content = replay_page(played, town, folder.absolute().name)
            with writing(target) as temporary:
                temporary.write_bytes(content)
    for former, result in zip(formers, results, strict=True):
        if former.is_contradicted_by(result):
            out.line(f"{former.file}: {former.verdict(result)}")
    out.line(f"Written: {target}.")
