"""`pavetwin replay`: a mission as one file that plays without a server, or as a recording for rerun."""

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from pavetwin.cli.arguments import CacheFolder
from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError

SUFFIXES = (".html", ".rrd")


def replay(
    folder: Annotated[
        Path,
        typer.Argument(metavar="MISSION", help="Folder of a mission or of missions under several policies."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A .html file, replay.html in the folder unless given; or .rrd for rerun, where that is installed.",
        ),
    ] = None,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
) -> None:
    """Write a mission as one HTML file that plays in any browser, without a server and without a network.

    \b
    pavetwin replay worlds/town/missions/hover-los-C-1-10m-default-seed1
    pavetwin replay missions/monday -o monday.html
    pavetwin replay missions/monday -o monday.rrd

    The mission is flown again for its traffic. A recording (.rrd) needs `pip install rerun-sdk`.
    """
    target = output or folder / "replay.html"
    if target.suffix not in SUFFIXES:
        raise PaveTwinError(f"`output` '{target}': name a file that ends in {' or '.join(SUFFIXES)}.")
    if target.is_dir():
        raise PaveTwinError(f"`output` '{target}' is a folder; name a file.")

    from pavetwin.app.flights import again, descriptions, write_played
    from pavetwin.app.replay_page import replay_page
    from pavetwin.app.rerun_file import check_installed, write_rerun
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
    with progress("Flying it again") as tell:
        results, inputs = again(files, world, tell)
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
