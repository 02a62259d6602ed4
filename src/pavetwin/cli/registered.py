"""`pavetwin policy …`, `pavetwin sensor …` and `pavetwin aircraft …`: list, check, show and fit."""

from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from pavetwin.cli.commands import Commands, in_options
from pavetwin.cli.console import out, progress
from pavetwin.cli.options import detector_file
from pavetwin.errors import PaveTwinError, naming
from pavetwin.perception.model_file import DEFAULT
from pavetwin.registry import BrokenRulesError
from pavetwin.reports.words import counted

if TYPE_CHECKING:
    from pavetwin.sensing.fit.look_tables import LookSource
    from pavetwin.sensing.fitted_sensor import EntryModel, SensorModel
    from pavetwin.uav import AircraftProfile


MISSION = "mission.yaml"


def fit(
    context: typer.Context,
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="MISSIONS|DATASET...",
            help="Folders of missions of the sensor detector, folders of such folders, or datasets of "
            "`pavetwin capture`.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to write, such as sensor.json.")],
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.onnx",
            help=f"Detector that searches datasets: one that ships, or a file. Default: {DEFAULT}.",
        ),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(metavar="MISSIONS|DATASET", help="Data to compare the fit with; may be repeated."),
    ] = None,
    confidence: Annotated[
        float,
        typer.Option(help="Lowest confidence of detections in datasets, from 0 to 1; missions hold their own."),
    ] = 0.25,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
) -> None:
    """Fit the sensor calibrated: the probability that a detector finds a defect, without rendering.

    \b
    pavetwin fly worlds/town --sensor detector --altitude 10 -o missions/a
    pavetwin sensor fit missions -o sensor.json
    pavetwin sensor fit missions captures/town --check missions-elsewhere -o sensor.json
    pavetwin fly worlds/town --sensor calibrated --model sensor.json

    Only missions, with several captures of each defect, determine the correlation between captures of one defect. A
    figure next to the file (.png) compares predicted probabilities with the shares found. Unusable missions are listed
    and left out.
    """
    from pavetwin.draw.sensor_figure import save_sensor_figure
    from pavetwin.sensing.fit.fitting import fit_sensor

    if output.suffix != ".json":
        raise PaveTwinError(f"`output` '{output}': the file is JSON; give a name such as {output.stem}.json.")
    if output.exists() and not force:
        raise PaveTwinError(f"`output` '{output}' exists; choose another name, or add `force`.")
    if model is not None:
        detector_file(model)
    for place in check or ():
        if not place.is_dir():
            raise PaveTwinError(f"`check`: there is no folder '{place}'; name that of a mission or of a dataset.")
    with progress("Reading", lines=True) as show:
        read = _read_looks(sources, model, confidence, show)
        others = _read_looks(check or [], model, confidence, show)
        show(1.0, "Fitting")
        fitted = fit_sensor(read.looks)
        for other in others.looks:
            if other.detector.sha256 != fitted.detector.sha256:
                raise PaveTwinError(f"`check`: '{other.name}' was searched by another detector.")
        entries, unread = _fit_entries(read.missions)
        fitted = fitted.model_copy(update={"entries": entries})
        fitted.save(output)
        compared, are_others = others.looks or read.looks, bool(others.looks)
        save_sensor_figure(fitted, compared, output.with_suffix(".png"), are_others=are_others)
    for reason in (*read.left_out, *others.left_out):
        out.line(in_options(f"Left out: {reason}", context.command))
    _report_fit(fitted, compared, are_others=are_others)
    if unread:
        out.line(
            f"Left out of the fit of inventory entries: {counted(len(unread), 'mission')}, such as this: {unread[0]}"
        )
    out.line(f"Sensor: {output}; figure: {output.with_suffix('.png')}.")


class _Looks(NamedTuple):
    looks: list["LookSource"]
    missions: list[Path]
    """Folders of the missions among the sources."""
    left_out: list[str]
    """Reasons why missions are left out."""


def _read_looks(
    sources: Sequence[Path], model: str | None, confidence: float, show: Callable[[float, str], None]
) -> _Looks:
    """Raises:
    PaveTwinError: there is no such folder, a dataset cannot be searched, or none of the missions can be used.
    """
    from pavetwin.capture.looks import is_capture, looks_of
    from pavetwin.mission.folder import MissionFolder

    read = _Looks([], [], [])
    for source in sources:
        if not source.is_dir():
            raise PaveTwinError(f"There is no folder '{source}'; name that of a mission or of a dataset.")
        if is_capture(source):
            on_progress = partial(_report_search, show, source.name)
            read.looks.append(looks_of(source, detector_file(model), confidence, on_progress))
            continue
        missions = sorted(path.parent for path in source.rglob(MISSION))
        if not missions:
            raise PaveTwinError(
                f"'{source}' holds no {MISSION} and no capture.yaml; name missions of `pavetwin fly --sensor detector` "
                "or a dataset of `pavetwin capture`."
            )
        for folder in missions:
            try:
                read.looks.append(MissionFolder(folder).looks())
                read.missions.append(folder)
            except PaveTwinError as error:
                read.left_out.append(str(error))
    if read.left_out and not read.looks:
        more = f" None of {len(read.left_out)} missions can be used." if len(read.left_out) > 1 else ""
        raise PaveTwinError(f"{read.left_out[0]}{more}")
    return read


def _fit_entries(missions: Sequence[Path]) -> tuple["EntryModel | None", list[str]]:
    """A model of inventory entries, and the reasons why missions are left out of it."""
    from pavetwin.inventory.entry_fit import JudgedInventory, fit_entries, judged_inventory

    found: list[JudgedInventory] = []
    unread: list[str] = []
    for folder in missions:
        try:
            found.append(judged_inventory(folder))
        except PaveTwinError as error:
            unread.append(str(error))
    return fit_entries(found), unread


def _report_search(show: Callable[[float, str], None], name: str, share: float) -> None:
    show(share, f"Searching {name}")


def _report_fit(fitted: "SensorModel", sources: Sequence["LookSource"], *, are_others: bool) -> None:
    import numpy as np
    import polars as pl

    from pavetwin.sensing.fit.fitting import reliability

    to = fitted.fitted_to
    out.line(
        f"Fitted to {to.looks} views of {to.defects} defects, {to.repeated} of them with several, in {to.images} "
        f"images of {to.pixel_mm[0]:.1f} to {to.pixel_mm[1]:.1f} mm per pixel; {100 * to.found / to.looks:.0f} % "
        "of the views were detected."
    )
    low, high = (
        float(np.exp(fitted.log_spread.estimate + z * fitted.log_spread.standard_error)) for z in (-1.96, 1.96)
    )
    shares = [spread**2 / (1 + spread**2) for spread in (low, fitted.spread, high)]
    out.line(
        f"Views of one defect have the correlation {shares[1]:.2f} (95 % interval {shares[0]:.2f} to {shares[2]:.2f})."
    )
    seen = reliability(fitted, pl.concat([each.looks for each in sources]))
    off = float(np.abs(seen.predicted - seen.observed).mean())
    where = "views that the fit does not use" if are_others else "the views of the fit"
    bias = float(seen.predicted.mean() - seen.observed.mean())
    out.line(f"Predicted and observed shares differ by {100 * off:.1f} points in {where} (mean {100 * bias:+.1f}).")
    if fitted.entries is not None:
        share = 100 * fitted.entries.defect_share
        out.line(f"{share:.0f} % of {fitted.entries.entries} inventory entries show a defect.")
    for kind, alarms in fitted.false_alarms.items():
        fine, coarse = (100 * alarms.per_m2(mm / 1000) for mm in to.pixel_mm)
        out.line(f"False alarms of {kind}: {fine:.2f} to {coarse:.2f} per 100 m² of an image.")


def _group(kind: str, plural: str, package: str, example: str, load: Callable[[Any, str], Any]) -> typer.Typer:
    """Commands of one registry.

    Args:
        load: makes an instance from the module of the package and a name.
    """
    group = Commands(help=f"List {plural}, and check your own.", no_args_is_help=True)

    @group.command("list", help=_help(f"List the {plural} and what each does.", f"{kind} list --plugin my_things.py"))
    def list_registered() -> None:
        registry = getattr(import_module(package), plural.upper())
        for name, value in zip(registry.names(), registry.values(), strict=True):
            words = (value.__doc__ or "").split("\n\n")[0]
            out.print(f"[bold]{name}[/]: {' '.join(words.split())}")

    @group.command(help=_help(f"Check that a {kind} follows the rules in many situations.", f"{kind} check {example}"))
    def check(
        name: Annotated[str, typer.Argument(metavar="FILE.py:ClassName", help=f"Your own {kind}, or a known one.")],
        verbose: Annotated[bool, typer.Option("--verbose", help="List every broken rule.")] = False,
    ) -> None:
        module = import_module(package)
        with naming({getattr(module, plural.upper()).key: f"{kind} check"}):
            try:
                checked = load(module, name)
            except BrokenRulesError as error:
                if verbose:
                    out.line("\n".join(f"  {rule}" for rule in error.rules))
                    raise
                raise PaveTwinError(str(error).replace(" more).", " more; --verbose lists them).")) from error
            out.print(f"{checked.name}: follows all rules.")

    return group


def _help(words: str, example: str) -> str:
    return f"{words}\n\n\b\npavetwin {example}"


def _policy(module: Any, name: str) -> Any:
    from pavetwin.config.mission import PolicySettings

    return module.load_policy(name, PolicySettings())


def _sensor(module: Any, name: str) -> Any:
    from pavetwin.config.mission import SensingSettings

    return module.load_sensor(SensingSettings(sensor=name), 0)


policy = _group("policy", "policies", "pavetwin.policies", "my_policy.py:Careful", _policy)
sensor = _group("sensor", "sensors", "pavetwin.sensing", "my_sensor.py:Sharp", _sensor)
sensor.command("fit")(fit)


aircraft = Commands(help="List aircraft, and show one.", no_args_is_help=True)


@aircraft.command("list")
def list_aircraft() -> None:
    """List the known aircraft: flight and hover time in still air, rated wind, camera.

    Figures are the manufacturers'; ~ marks those of the model.

    \b
    pavetwin aircraft list
    """
    from rich.table import Table

    from pavetwin.uav import AIRCRAFT, find_camera
    from pavetwin.uav.energy import rotor_power

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("name", "aircraft", "kg", "flight\nmin", "hover\nmin", "wind\nm/s", "mm/px\nat 10 m"):
        table.add_column(name, justify="left" if name in ("name", "aircraft") else "right", vertical="bottom")
    for name, profile in zip(AIRCRAFT.names(), AIRCRAFT.values(), strict=True):
        power_w, camera = rotor_power(profile).total_w, find_camera(profile.camera)
        minutes = [60 * profile.capacity_wh / watts for watts in (power_w.min(), power_w[0])]
        pixel_mm = 1000 * camera.footprint_m(10.0)[1] / camera.image_px[1]
        stated = (profile.payload_kg == 0, profile.payload_kg == 0 and profile.hover_time_min is not None)
        times = (f"{'' if known else '~'}{each:.0f}" for each, known in zip(minutes, stated, strict=True))
        figures = (f"{profile.flown_kg():.2f}", *times)
        table.add_row(name, profile.title, *figures, f"{profile.wind_limit_mps:g}", f"{pixel_mm:.1f}")
    out.print(table)
    out.line("Times in still air, from a full to an empty battery; missions use less (energy.usable, energy.reserve).")
    out.line("~: time of the model, where the manufacturer states none with this camera; the rest is from data sheets.")


@aircraft.command("show")
def show_aircraft(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE.yaml", help="A known aircraft, or your own file.")],
) -> None:
    """Show one aircraft: the manufacturer's figures with their sources, and the model's power and tilt over airspeed.

    The output is a file for an aircraft of your own: change its figures.

    \b
    pavetwin aircraft show mavic3e
    pavetwin aircraft show mavic3e > mine.yaml
    pavetwin aircraft show mine.yaml:mavic3e
    """
    from pathlib import Path

    import yaml

    from pavetwin.uav import find_aircraft, find_camera
    from pavetwin.uav.energy import airspeeds, rotor_power
    from pavetwin.uav.wind import tilt_deg

    profile = find_aircraft(name)
    find_camera(profile.camera)
    entry = {Path(name.rpartition(":")[2]).stem: profile.model_dump(mode="json", exclude_defaults=True)}
    out.line("# Figures of the manufacturer, except where the sources state otherwise")
    out.print(yaml.safe_dump(entry, sort_keys=False, allow_unicode=True, width=100).rstrip(), markup=False)
    power_w, speeds = rotor_power(profile).total_w, airspeeds()
    out.line("\n# Figures of the model, from these")
    for line in (*_modelled_figures(profile), "", "airspeed m/s  power W  tilt °"):
        out.line(f"# {line}".rstrip())
    for mps in range(0, int(profile.top_speed_mps) + 1, 2):
        row = int(abs(speeds - mps).argmin())
        out.line(f"# {mps:12d} {power_w[row]:8.0f} {tilt_deg(profile, mps):7.1f}")


def _modelled_figures(profile: "AircraftProfile") -> list[str]:
    """Figures of an aircraft that no manufacturer states, with their origin."""
    from pavetwin.uav.aircraft import FUSELAGE_DRAG_RATIO, ROTOR_SOLIDITY
    from pavetwin.uav.energy import BLADE_SHARE, TIP_MPS, airspeeds, rotor_power

    power_w = rotor_power(profile).total_w
    best, hover_min = int(power_w.argmin()), 60 * profile.capacity_wh / power_w[0]
    anchors = "time" if profile.hover_time_min is None else "times in flight and in hover"
    drag = f"tilt and {profile.top_speed_mps:g} m/s"
    if profile.tilt_deg is None:
        drag = f"{FUSELAGE_DRAG_RATIO * ROTOR_SOLIDITY:g} of the rotors' discs, assumed"
    minutes = 60 * profile.capacity_wh / power_w[best]
    lines = [f"least power at {airspeeds()[best]:.1f} m/s: {minutes:.0f} min (scaled to the manufacturer's {anchors})"]
    if profile.hover_time_min is None or profile.payload_kg:
        lines.append(f"hover: {hover_min:.0f} min (predicted; within 7 % for eight aircraft with stated times)")
    return [
        *lines,
        f"drag area: {10_000 * profile.drag_area_m2:.0f} cm² ({drag})",
        f"assumed: blade tips at {TIP_MPS:g} m/s, blade over induced power in hover {BLADE_SHARE:.2f}",
    ]
