"""`pavetwin traffic …`: record traffic with SUMO."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import out, progress
from pavetwin.cli.options import CacheFolder, TrafficLevel, WorldFolder, grouped
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.traffic.demand import Density
    from pavetwin.traffic.recording import Recording

app = Commands(help="Record traffic over a world with SUMO.", no_args_is_help=True)


@app.command()
@grouped
def record(
    world: WorldFolder,
    level: TrafficLevel,
    vehicles_per_lane_km: Annotated[
        float | None, typer.Option(help="Instead: vehicles per kilometre of driving lane.")
    ] = None,
    pedestrians_per_sidewalk_km: Annotated[
        float | None, typer.Option(help="Instead: pedestrians per kilometre of sidewalk.")
    ] = None,
    routes: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE.rou.xml", help="Your own SUMO demand, unchanged; may be repeated."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Random seed of the traffic; 0 is valid.")] = 0,
    duration: Annotated[float, typer.Option(help="Length of the recording, in seconds.")] = 600.0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.parquet", help="Also write this file."),
    ] = None,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
    force: Annotated[bool, typer.Option("--force", help="Record again even if this traffic is in the cache.")] = False,
) -> None:
    """Record traffic over a world, or use the recording of the same inputs from the cache.

    \b
    pavetwin traffic record worlds/town --los E --mix east_asia --seed 1 --duration 600 -o busy.parquet
    pavetwin traffic record worlds/town --hour 8
    pavetwin traffic record worlds/town --density high
    pavetwin traffic record worlds/town --vehicles-per-lane-km 12 --pedestrians-per-sidewalk-km 0
    pavetwin traffic record worlds/town --routes mine.rou.xml --duration 900
    """
    from pavetwin.traffic.record import record as record_traffic
    from pavetwin.traffic.recording_file import save_recording
    from pavetwin.world.store import load_world

    if routes and level.mix is not None:
        raise PaveTwinError("`mix`: routes define their own vehicle types; omit it.")
    asked = _density(level, vehicles_per_lane_km, pedestrians_per_sidewalk_km, routes or [])
    loaded = load_world(world)
    started, simulated = time.perf_counter(), [False]
    with progress(f"Recording {duration:g} s of traffic") as show:

        def advance(share: float) -> None:
            simulated[0] = True
            show(share)

        search = f"Finding the demand of {asked.name}, cached for later runs" if asked else ""
        recording = record_traffic(
            loaded,
            asked,
            seed,
            duration,
            routes=routes or (),
            force=force,
            on_progress=advance,
            on_search=lambda share: show(share, search),
        )
        if output is not None:
            recording = save_recording(recording, output)
    taken_s = time.perf_counter() - started
    _print(recording)
    if simulated[0]:
        out.print(f"Recorded in {taken_s:.1f} s, {recording.duration_s / taken_s:.0f} × real time.")
    else:
        out.print("Taken from the cache; --force records it again.")


@app.command()
def info(
    file: Annotated[Path, typer.Argument(metavar="FILE.parquet", help="A recording.")],
) -> None:
    """Summarise a recording and the flow of its traffic.

    \b
    pavetwin traffic info high.parquet
    """
    from pavetwin.traffic.recording_file import load_recording

    _print(load_recording(file))


@app.command()
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.parquet", help="A recording.")],
    target: Annotated[Path, typer.Argument(help="The file to write, ending in .parquet or .csv.")],
    start: Annotated[float, typer.Option("--from", help="Start, in seconds of the recording.")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", help="End; default: that of the recording.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
) -> None:
    """Write part of a recording as a table with one row per agent and time step, as in SUMO's floating car data.

    \b
    pavetwin traffic export high.parquet high-fcd.parquet
    pavetwin traffic export high.parquet rush.csv --from 120 --to 180
    """
    from pavetwin.traffic.recording_file import export_fcd, load_recording

    if target.exists() and not force:
        raise PaveTwinError(f"`target` '{target}' exists; choose another name, or add `force`.")
    recording = load_recording(file)
    with progress("Writing") as show:
        count = export_fcd(recording, target, start, end, show)
    out.line(f"{count} rows in {target}.")


def _density(
    level: TrafficLevel,
    vehicles: float | None,
    pedestrians: float | None,
    routes: list[Path],
) -> "Density | None":
    """The requested density; None for the user's own routes.

    Raises:
        PaveTwinError: the options contradict each other, or none gives an amount of traffic.
    """
    from pavetwin.traffic.demand import density_named, density_of

    own = vehicles is not None or pedestrians is not None
    named = any(option is not None for option in (level.density, level.los, level.hour))
    if sum((named, own, bool(routes))) > 1:
        raise PaveTwinError("Choose one: --los, --hour, --density, the two densities of your own, or --routes.")
    if routes:
        return None
    if own:
        return density_named(density_of(vehicles or 0.0, pedestrians or 0.0).name, level.mix or "")
    asked = level.name
    if asked is None:
        raise PaveTwinError(
            "Give an amount of traffic: --los A to F, --hour 0 to 23, --density low, medium, high or v12-p40 (vehicles "
            "per kilometre of lane, pedestrians per kilometre of sidewalk), or --routes."
        )
    return density_named(asked)


def _print(recording: "Recording") -> None:
    from collections import Counter

    from rich.table import Table

    from pavetwin.traffic.flow import flow_of

    flow = flow_of(recording)
    origin, (vehicles, pedestrians) = recording.origin, recording.counts
    table = Table(box=None, pad_edge=False)
    for heading in ("", "requested", "achieved", "at a time", "in total"):
        table.add_column(heading, justify="left" if not heading else "right")
    walks = int(recording.agents.is_pedestrian.sum())
    asked = origin.asked
    rows = (
        ("vehicles per lane-km", asked and asked.vehicles_per_lane_km, recording.vehicles_per_lane_km, vehicles),
        (
            "pedestrians per sidewalk-km",
            asked and asked.pedestrians_per_sidewalk_km,
            recording.pedestrians_per_sidewalk_km,
            pedestrians,
        ),
    )
    for (what, wanted, achieved, counts), total in zip(rows, (len(recording.agents) - walks, walks), strict=True):
        table.add_row(
            what,
            "–" if wanted is None else f"{wanted:g}",
            "–" if achieved is None else f"{achieved:.1f}",
            f"{counts.min()}–{counts.max()}",
            str(total),
        )
    out.print(f"{recording.name} traffic, seed {origin.seed}, {recording.duration_s:g} s every {recording.step_s:g} s")
    out.print(table)
    out.print(flow.sentence)
    out.print(flow.removals_sentence)
    kinds = Counter(recording.agents.kind)
    if kinds:
        out.print("Kinds: " + ", ".join(f"{count} {kind}" for kind, count in kinds.most_common()))
    out.print(
        f"Network: {origin.capacity.lanes_km:.2f} km of lanes, {origin.capacity.sidewalks_km:.2f} km of sidewalks, "
        f"{len(recording.signals)} traffic lights."
    )
    out.print(f"{origin.sumo_version}, {origin.warm_up_s:g} s of warm-up before.")
    for remark in recording.remarks:
        out.print(f"[yellow]Note:[/] {remark}.")
    if recording.path is not None:
        out.line(f"File: {recording.path}")
