"""`pavetwin pci`: the Pavement Condition Index of a world, or of what a mission found."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.errors import PaveTwinError
from pavetwin.files import check_writable, unwritable

if TYPE_CHECKING:
    import polars as pl
    from rich.table import Table

    from pavetwin.mission.condition import ConditionReport

MAP, MAP_FOUND, MAP_DETECTED = "pci.png", "pci-found.png", "pci-detected.png"

SHOWN: Final = 20
"""Streets in the printed table; the file has all."""


def pci(
    folder: Annotated[Path, typer.Argument(metavar="WORLD|MISSION", help="Folder of a world or of a mission.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; pci in the given folder unless given.")
    ] = None,
) -> None:
    """Rate pavement by ASTM D6433: by sample unit and street, as it is and as a mission found it.

    \b
    pavetwin pci worlds/berlin
    pavetwin pci missions/monday/hover -o reports/monday

    What a mission missed is missing from its index, so that roads look sounder than they are. If its sensor measures,
    as detector does, the index by these sizes stands beside it. Writes units.csv, streets.csv, pci.gpkg (for QGIS) and
    maps.
    """
    from pavetwin.draw.condition_maps import save_pci_map
    from pavetwin.mission.condition import write_condition
    from pavetwin.pci import rating_of

    if not folder.is_dir():
        raise PaveTwinError(f"There is no folder '{folder}'; name that of a world or of a mission.")
    target = output or folder / "pci"
    if target.exists() and not target.is_dir():
        raise PaveTwinError(f"--output {target}: a file of that name is in the way; name a folder.")
    check_writable(target / MAP)
    with progress("Surveying") as tell:
        report = _report(folder)
        tell(0.5)
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(target, error) from error
        write_condition(report, target)
        tell(0.7)
        for other in (MAP_FOUND, MAP_DETECTED):  # of a former survey in the folder
            (target / other).unlink(missing_ok=True)
        save_pci_map(report.world, report.true, target / MAP, subtitle=f"as it is: {report.pci:.0f} on average")
        if report.found is not None:
            words = f"as the mission found it: {report.pci_found:.0f} on average, as it is: {report.pci:.0f}"
            save_pci_map(report.world, report.found, target / MAP_FOUND, subtitle=words)
        if report.detected is not None:
            words = f"as its sensor measured it: {report.pci_detected:.0f} on average, as it is: {report.pci:.0f}"
            save_pci_map(report.world, report.detected, target / MAP_DETECTED, subtitle=words)
        tell(1.0)
    out.print(_table(report))
    out.line(f"PCI {report.pci:.1f}, {rating_of(report.pci).value}, over {len(report.true)} sample units.")
    if report.pci_found is not None:
        more = report.pci_found - report.pci
        out.line(f"Of what was found it would be {report.pci_found:.1f}: {abs(more):.1f} points too {_side(more)}.")
    if report.pci_detected is not None:
        assert report.detected is not None
        more = report.pci_detected - report.pci
        apart = [abs(mine.pci - true.pci) for mine, true in zip(report.detected, report.true, strict=True)]
        out.line(
            f"By what the sensor measured it would be {report.pci_detected:.1f}: {abs(more):.1f} points too "
            f"{_side(more)}; single units differ by {sum(apart) / len(apart):.1f} on average."
        )
    if small := sum(not condition.unit.has_usual_size for condition in report.true):
        units = "unit is" if small == 1 else "units are"
        out.line(f"{small} {units} smaller than the 135 m² of the standard, as the segments are.")
    for name, number in report.not_counted.items():
        defects = "a defect" if number == 1 else f"{number} defects"
        out.line(f"Not counted: {defects} of the class '{name}', for which the standard's distress is not known here.")
    out.line(f"Written to {target}.")
    note_fonts(report.world)


def _side(more: float) -> str:
    return "high" if more >= 0 else "low"


def _report(folder: Path) -> "ConditionReport":
    """Raises:
    PaveTwinError: the folder is neither a world nor a mission.
    """
    from pavetwin.inventory.condition import with_detected
    from pavetwin.inventory.of_mission import flown
    from pavetwin.mission.condition import condition_of_mission, condition_of_world
    from pavetwin.mission.folder import MissionFolder, mission_file
    from pavetwin.mission.saving import DETECTIONS, MISSION
    from pavetwin.world.folder import DESCRIPTION
    from pavetwin.world.store import load_world

    if (folder / DESCRIPTION).is_file():
        return condition_of_world(load_world(folder))
    if folder.is_dir() and mission_file(folder).is_file():
        mission = MissionFolder(folder)
        report = condition_of_mission(mission)
        return with_detected(report, flown(mission)) if (mission.folder / DETECTIONS).is_file() else report
    raise PaveTwinError(f"'{folder}' is neither the folder of a world nor of a mission (it has no {MISSION}).")


def _table(report: "ConditionReport") -> "Table":
    from rich.table import Table

    from pavetwin.mission.condition import street_condition

    streets: pl.DataFrame = street_condition(report)
    table = Table(box=None, pad_edge=False, header_style="bold")
    headings = ["street", "units", "area\nm²", "PCI", "rating", "worst unit"]
    if report.found is not None:
        headings += ["PCI of\nwhat was\nfound", "rating\nof that"]
    if report.detected is not None:
        headings += ["PCI by\nmeasured\nsizes", "rating\nby sizes"]
    for heading in headings:
        left = heading in ("street", "rating", "worst unit", "rating\nof that", "rating\nby sizes")
        table.add_column(heading, justify="left" if left else "right", vertical="bottom", no_wrap=heading != "street")
    for row in streets.head(SHOWN).iter_rows(named=True):
        cells = [row["street"], f"{row['units']}", f"{row['area_m2']:.0f}", f"{row['pci']:.1f}", row["rating"]]
        cells.append(f"{row['worst_unit']}: {row['worst_pci']:.0f}")
        if report.found is not None:
            cells += [f"{row['pci_found']:.1f}", row["rating_found"]]
        if report.detected is not None:
            cells += [f"{row['pci_detected']:.1f}", row["rating_detected"]]
        table.add_row(*cells)
    if streets.height > SHOWN:
        table.caption = f"and {streets.height - SHOWN} more streets in streets.csv; the worst come first"
        table.caption_justify = "left"
    return table
