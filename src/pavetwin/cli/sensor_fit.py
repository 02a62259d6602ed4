"""`pavetwin sensor fit`: the sensor `calibrated` from what a detector found in rendered captures."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.detect import named
from pavetwin.errors import PaveTwinError
from pavetwin.perception.shipped import DEFAULT

if TYPE_CHECKING:
    from pavetwin.sensing.entry_model import EntryModel
    from pavetwin.sensing.fit.tables import LookSource
    from pavetwin.sensing.sensor_model import SensorModel

MISSION = "mission.yaml"


def fit(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="MISSIONS|DATASET...",
            help="Folders of missions of the sensor detector, folders of such folders, or datasets of "
            "`pavetwin capture`.",
        ),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file, such as sensor.json.")] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.onnx",
            help=f"The detector that searches datasets: one that ships, or a file; {DEFAULT} unless given.",
        ),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(metavar="MISSIONS|DATASET", help="Compare with these, which are not fitted to; may be repeated."),
    ] = None,
    confidence: Annotated[
        float,
        typer.Option(help="The least confidence of what counts in datasets, from 0 to 1; missions say their own."),
    ] = 0.25,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
) -> None:
    """Fit the sensor calibrated: the chance that a detector finds a defect, without rendering.

    \b
    pavetwin fly worlds/town --sensor detector --altitude 10 -o missions/a
    pavetwin sensor fit missions -o sensor.json
    pavetwin sensor fit missions captures/town --check missions-elsewhere -o sensor.json
    pavetwin fly worlds/town --sensor calibrated --model sensor.json

    What defects keep from look to look shows in missions alone, where many captures show one defect. Beside the file, a
    figure of the same name (.png) compares chances and repeated looks with what was found. Missions that cannot be used
    are named and left out.
    """
    from typer.main import get_group

    from pavetwin.cli import app
    from pavetwin.cli.flags import with_flags
    from pavetwin.draw.sensor_figure import save_sensor_figure
    from pavetwin.sensing.fit.fitting import fit_sensor

    if output is None:
        raise PaveTwinError("Say where the file goes with -o, for example -o sensor.json.")
    if output.suffix != ".json":
        raise PaveTwinError(f"`output` '{output}': the file is JSON; give a name such as {output.stem}.json.")
    if output.exists() and not force:
        raise PaveTwinError(f"`output` '{output}' exists; choose another name, or add `force`.")
    if model is not None:
        named(model)
    for place in check or ():
        if not place.is_dir():
            raise PaveTwinError(f"`check`: there is no folder '{place}'; name that of a mission or of a dataset.")
    with progress("Reading", lines=True) as tell:
        read = _read(sources, model, confidence, tell)
        others = _read(check or [], model, confidence, tell)
        tell(1.0, "Fitting")
        fitted = fit_sensor(read.looks)
        for other in others.looks:
            if other.detector.sha256 != fitted.detector.sha256:
                raise PaveTwinError(f"`check`: '{other.name}' was searched by another detector.")
        entries, unread = _entries(read.missions)
        fitted = fitted.model_copy(update={"entries": entries})
        fitted.save(output)
        compared, are_others = others.looks or read.looks, bool(others.looks)
        save_sensor_figure(fitted, compared, output.with_suffix(".png"), are_others=are_others)
    for reason in (*read.left_out, *others.left_out):
        out.line(with_flags(f"Left out: {reason}", ["sensor", "fit"], get_group(app)))
    _tell(fitted, compared, are_others=are_others)
    if unread:
        missions = "a mission tells" if len(unread) == 1 else f"{len(unread)} missions tell"
        out.line(f"Of inventories {missions} nothing: {unread[0]}")
    out.line(f"Sensor: {output}; figure: {output.with_suffix('.png')}.")


class _Read(NamedTuple):
    looks: list["LookSource"]
    missions: list[Path]
    """Folders of those among them that are missions."""
    left_out: list[str]
    """Why others are not."""


def _read(sources: Sequence[Path], model: str | None, confidence: float, tell: Callable[[float, str], None]) -> _Read:
    """Raises:
    PaveTwinError: there is no such folder, a dataset cannot be searched, or none of the missions can be used.
    """
    from pavetwin.capture.looks import is_capture, looks_of
    from pavetwin.mission.folder import MissionFolder

    read = _Read([], [], [])
    for source in sources:
        if not source.is_dir():
            raise PaveTwinError(f"There is no folder '{source}'; name that of a mission or of a dataset.")
        if is_capture(source):
            read.looks.append(looks_of(source, named(model), confidence, partial(_searched, tell, source.name)))
            continue
        missions = sorted(path.parent for path in source.rglob(MISSION))
        if not missions:
            raise PaveTwinError(
                f"'{source}' holds no {MISSION} and no capture.yaml; name missions of `pavetwin fly sensor=detector`, "
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


def _entries(missions: Sequence[Path]) -> tuple["EntryModel | None", list[str]]:
    """What missions tell of entries of inventories, and why some of them tell nothing."""
    from pavetwin.inventory.entry_fit import JudgedInventory, fit_entries, judged_inventory

    found: list[JudgedInventory] = []
    unread: list[str] = []
    for folder in missions:
        try:
            found.append(judged_inventory(folder))
        except PaveTwinError as error:
            unread.append(str(error))
    return fit_entries(found), unread


def _searched(tell: Callable[[float, str], None], name: str, share: float) -> None:
    tell(share, f"Searching {name}")


def _tell(fitted: "SensorModel", sources: Sequence["LookSource"], *, are_others: bool) -> None:
    import numpy as np
    import polars as pl

    from pavetwin.sensing.fit.fitting import reliability

    to = fitted.fitted_to
    out.line(
        f"Fitted to {to.looks} looks at {to.defects} defects, {to.repeated} of them with several looks, in {to.images} "
        f"images of {to.pixel_mm[0]:.1f} to {to.pixel_mm[1]:.1f} mm a pixel; {100 * to.found / to.looks:.0f} % of the "
        "looks found their defect."
    )
    low, high = (
        float(np.exp(fitted.log_spread.estimate + z * fitted.log_spread.standard_error)) for z in (-1.96, 1.96)
    )
    shares = [spread**2 / (1 + spread**2) for spread in (low, fitted.spread, high)]
    out.line(
        f"Looks at one defect have the correlation {shares[1]:.2f} (95 % interval {shares[0]:.2f} to {shares[2]:.2f})."
    )
    seen = reliability(fitted, pl.concat([each.looks for each in sources]))
    off = float(np.abs(seen.predicted - seen.observed).mean())
    where = "looks that it was not fitted to" if are_others else "the looks that it was fitted to"
    bias = float(seen.predicted.mean() - seen.observed.mean())
    out.line(f"Chances and shares found differ by {100 * off:.1f} points in {where} (mean {100 * bias:+.1f}).")
    if fitted.entries is not None:
        share = 100 * fitted.entries.defect_share
        out.line(f"Of {fitted.entries.entries} entries of inventories {share:.0f} % show a defect.")
    for kind, alarms in fitted.false_alarms.items():
        fine, coarse = (100 * alarms.per_m2(mm / 1000) for mm in to.pixel_mm)
        out.line(f"False alarms of {kind}: {fine:.2f} to {coarse:.2f} for each 100 m² of an image.")
