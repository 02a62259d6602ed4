"""`pavetwin inventory` and `pavetwin pci`: defects and condition of roads."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from pavetwin.cli.commands import in_options
from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.cli.options import DetectorOptions, check_empty, grouped, was_given
from pavetwin.errors import PaveTwinError
from pavetwin.files import check_writable, unwritable
from pavetwin.reports.words import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import polars as pl
    from rich.table import Table

    from pavetwin.inventory.entry import Entry
    from pavetwin.inventory.reading import Reading
    from pavetwin.mission.condition import ConditionReport


MISSION = "mission.yaml"


@dataclass(frozen=True)
class PhotographOptions:
    """Photographs."""

    gsd_mm: Annotated[
        float | None,
        typer.Option(
            help="Ground resolution of all photographs in millimetres per pixel, as in --gsd-mm 2.7; for sizes."
        ),
    ] = None
    height_m: Annotated[
        float | None,
        typer.Option(help="Height of all photographs above the ground; default: from their metadata."),
    ] = None


@grouped
def inventory(
    context: typer.Context,
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="MISSION...|PHOTOGRAPHS",
            help="Folder of photographs or of a mission; several missions are listed together.",
        ),
    ],
    detector: DetectorOptions,
    photographs: PhotographOptions,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the files; default for one source: inventory in it."),
    ] = None,
    position_error_m: Annotated[
        float | None,
        typer.Option(help="Standard deviation of the positions; default: from the metadata of photographs, or 0."),
    ] = None,
    fitted: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.json",
            help="Fitted sensor for the probability that an entry is a defect; default: the one that ships for "
            "the detector.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """List detected defects, each once: place, class, severity and sizes with their errors.

    \b
    pavetwin inventory missions/monday/hover
    pavetwin inventory missions/monday/hover missions/tuesday/hover -o both
    pavetwin inventory photographs -o inventory
    pavetwin inventory photographs --model model.onnx -o inventory --gsd-mm 2.7
    pavetwin inventory photographs --model model.onnx -o inventory --height-m 12 --position-error-m 0.5

    Writes inventory.gpkg (for QGIS, with its style), inventory.geojson, inventory.csv, and crops with contact sheets.
    """
    from pavetwin.inventory.files import write_inventory
    from pavetwin.inventory.reading import entries_of

    is_mission = _check_sources(sources, output)
    source = sources[0]
    target = output or source / "inventory"
    check_empty(target, force=force)
    with progress("Reading", lines=True) as show:
        if is_mission:
            from pavetwin.inventory.of_mission import flown, flown_together

            _refuse_for_missions(context)
            error_m = position_error_m or 0.0
            reading = (
                flown_together(sources, position_error_m=error_m, fitted=fitted)
                if len(sources) > 1
                else flown(source, position_error_m=error_m, fitted=fitted)
            )
        else:
            reading = _search_photographs(source, target, detector, photographs, position_error_m, fitted, show)
        show(1.0, "Writing")
        entries = entries_of(reading, detector.confidence)
        files = write_inventory(entries, reading, target)
    _print_inventory(context, reading, len(reading.confident(detector.confidence)), entries)
    has_crops = any((target / "crops").glob("*.jpg"))
    names = ", ".join([*(file.name for file in files), *(("crops/", "crops-01.jpg, …") if has_crops else ())])
    out.line(f"Results: {target} ({names})")


def _check_sources(sources: "Sequence[Path]", output: Path | None) -> bool:
    """Whether the sources are missions.

    Raises:
        PaveTwinError: a folder is neither a mission nor photographs, or several are not all missions.
    """
    from pavetwin.world.folder import DESCRIPTION

    source, *others = sources
    for each in sources:
        if not each.is_dir():
            raise PaveTwinError(f"There is no folder '{each}'; name that of a mission or of photographs.")
        if (each / DESCRIPTION).is_file():
            raise PaveTwinError(f"'{each}' is a world; name the folder of one of its missions, or of photographs.")
        if others and not (each / MISSION).is_file():
            raise PaveTwinError(f"'{each}' holds no {MISSION}; only missions are listed together.")
    if others and output is None:
        raise PaveTwinError("Name a folder for the inventory of several missions with `output`.")
    if (source / MISSION).is_file():
        return True
    if inner := sorted(path.parent.name for path in source.glob(f"*/{MISSION}")):
        names = ", ".join(str(source / name) for name in inner)
        raise PaveTwinError(f"'{source}' holds a mission for each policy; name one: {names}.")
    return False


def _search_photographs(
    source: Path,
    output: Path,
    chosen: DetectorOptions,
    photographs: PhotographOptions,
    position_error_m: float | None,
    fitted: str | None,
    show: "Callable[[float, str], None]",
) -> "Reading":
    from pavetwin.files import file_sha256
    from pavetwin.inventory.entry import entry_model
    from pavetwin.inventory.of_photographs import photographed
    from pavetwin.perception.detector import Detector

    file = chosen.file
    sha256 = file_sha256(file)
    # The models that ship were fitted without an overview, with which another share of the entries is right.
    known = entry_model(sha256, fitted) if fitted or not chosen.overview else None
    reading = photographed(
        Detector(file, confidence=chosen.confidence, tiled=chosen.tiled, overview=chosen.overview),
        source,
        gsd_mm=photographs.gsd_mm,
        height_m=photographs.height_m,
        position_error_m=position_error_m,
        output=output,
        report=show,
    )
    return replace(reading, detector=sha256, entry_model=known)


def _refuse_for_missions(context: typer.Context) -> None:
    """Raises:
    PaveTwinError: an option for photographs is given with a mission.
    """
    for name in ("model", "gsd_mm", "height_m", "tiled", "overview"):
        if was_given(context, name):
            raise PaveTwinError(f"`{name}` is for photographs; omit it for missions, which hold their detections.")


def _print_inventory(context: typer.Context, reading: "Reading", observations: int, listed: "Sequence[Entry]") -> None:
    from collections import Counter

    from pavetwin.inventory.entry import LIKELY
    from pavetwin.labels.class_names import display_name

    kinds = [display_name(entry.class_name) for entry in listed]
    found = Counter(kinds)
    parts = ", ".join(f"{kind} {number}" for kind, number in found.most_common())
    seen = f"{counted(observations, 'detection')} in {counted(reading.images, 'image')}"
    entries = f"{len(kinds)} {'entry' if len(kinds) == 1 else 'entries'}"
    out.line(f"{seen}: {entries}{f' ({parts})' if parts else ''}.")
    chances = [entry.probability for entry in listed if entry.probability is not None]
    if chances:
        likely = sum(chance >= LIKELY for chance in chances)
        out.line(
            f"Expected to show a defect, by the fitted sensor: {sum(chances):.1f}; more likely than not: {likely} "
            "(column probability)."
        )
    for remark in reading.remarks:
        out.line(in_options(remark, context.command))


MAP, MAP_FOUND, MAP_DETECTED = "pci.png", "pci-found.png", "pci-detected.png"

SHOWN: Final = 20
"""Streets in the printed table; the file has all."""


def pci(
    folder: Annotated[Path, typer.Argument(metavar="WORLD|MISSION", help="Folder of a world or of a mission.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; default: pci in the given folder.")
    ] = None,
) -> None:
    """Rate pavement by ASTM D6433: by sample unit and street, from all defects and from those that a mission found.

    \b
    pavetwin pci worlds/berlin
    pavetwin pci missions/monday/hover -o reports/monday

    Defects that a mission missed are not in its index, so roads look sounder than they are. If its sensor measures, as
    detector does, the index by measured sizes is shown as well. Writes units.csv, streets.csv, pci.gpkg (for QGIS) and
    maps.
    """
    from pavetwin.draw.condition_maps import save_pci_map
    from pavetwin.mission.condition import write_condition
    from pavetwin.pci import rating_of

    if not folder.is_dir():
        raise PaveTwinError(f"There is no folder '{folder}'; name that of a world or of a mission.")
    target = output or folder / "pci"
    if target.exists() and not target.is_dir():
        raise PaveTwinError(f"`output` {target}: there is a file of that name; name a folder.")
    check_writable(target / MAP)
    with progress("Surveying") as show:
        report = _surveyed(folder)
        show(0.5)
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(target, error) from error
        write_condition(report, target)
        show(0.7)
        for other in (MAP_FOUND, MAP_DETECTED):  # left by an earlier survey
            (target / other).unlink(missing_ok=True)
        save_pci_map(report.world, report.true, target / MAP, subtitle=f"as it is: {report.pci:.0f} on average")
        if report.found is not None:
            words = f"as the mission found it: {report.pci_found:.0f} on average, as it is: {report.pci:.0f}"
            save_pci_map(report.world, report.found, target / MAP_FOUND, subtitle=words)
        if report.detected is not None:
            words = f"as its sensor measured it: {report.pci_detected:.0f} on average, as it is: {report.pci:.0f}"
            save_pci_map(report.world, report.detected, target / MAP_DETECTED, subtitle=words)
        show(1.0)
    out.print(_pci_table(report))
    out.line(f"PCI {report.pci:.1f}, {rating_of(report.pci).value}, over {len(report.true)} sample units.")
    if report.pci_found is not None:
        more = report.pci_found - report.pci
        out.line(f"By the defects found it would be {report.pci_found:.1f}: {abs(more):.1f} points too {_side(more)}.")
    if report.pci_detected is not None:
        assert report.detected is not None
        more = report.pci_detected - report.pci
        apart = [abs(mine.pci - true.pci) for mine, true in zip(report.detected, report.true, strict=True)]
        out.line(
            f"By the measured sizes it would be {report.pci_detected:.1f}: {abs(more):.1f} points too "
            f"{_side(more)}; single units differ by {sum(apart) / len(apart):.1f} on average."
        )
    if small := sum(not condition.unit.has_usual_size for condition in report.true):
        units = "unit is" if small == 1 else "units are"
        out.line(f"{small} {units} smaller than the 135 m² of the standard, because the segments are.")
    for name, number in report.not_counted.items():
        defects = "a defect" if number == 1 else f"{number} defects"
        out.line(f"Not counted: {defects} of the class '{name}', which has no distress of the standard.")
    out.line(f"Written to {target}.")
    note_fonts(report.world)


def _side(more: float) -> str:
    return "high" if more >= 0 else "low"


def _surveyed(folder: Path) -> "ConditionReport":
    """Raises:
    PaveTwinError: the folder is neither a world nor a mission.
    """
    from pavetwin.inventory.condition import with_detected
    from pavetwin.inventory.of_mission import flown
    from pavetwin.mission.condition import condition_of_mission, condition_of_world
    from pavetwin.mission.folder import MissionFolder, mission_file
    from pavetwin.mission.saving import DETECTIONS
    from pavetwin.world.folder import DESCRIPTION
    from pavetwin.world.store import load_world

    if (folder / DESCRIPTION).is_file():
        return condition_of_world(load_world(folder))
    if folder.is_dir() and mission_file(folder).is_file():
        mission = MissionFolder(folder)
        report = condition_of_mission(mission)
        return (
            with_detected(report, flown(mission, frame=report.world.georeference))
            if (mission.folder / DETECTIONS).is_file()
            else report
        )
    raise PaveTwinError(f"'{folder}' is neither the folder of a world nor of a mission (it has no {MISSION}).")


def _pci_table(report: "ConditionReport") -> "Table":
    from rich.table import Table

    from pavetwin.mission.condition import street_condition

    streets: pl.DataFrame = street_condition(report)
    table = Table(box=None, pad_edge=False, header_style="bold")
    headings = ["street", "units", "area\nm²", "PCI", "rating", "worst unit"]
    if report.found is not None:
        headings += ["PCI of\ndefects\nfound", "rating\nby found"]
    if report.detected is not None:
        headings += ["PCI by\nmeasured\nsizes", "rating\nby sizes"]
    for heading in headings:
        left = heading in ("street", "rating", "worst unit", "rating\nby found", "rating\nby sizes")
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
