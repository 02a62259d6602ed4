"""`pavetwin inventory`: the defects of a road from a mission or from photographs, each once."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.detect import Model, Overview, named
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pavetwin.inventory.entry import Entry
    from pavetwin.inventory.reading import Reading

MISSION = "mission.yaml"


def inventory(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="MISSION...|PHOTOGRAPHS",
            help="Folder of photographs or of a mission; several missions are listed together.",
        ),
    ],
    model: Model = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the files; of one source inventory in it, unless given."),
    ] = None,
    confidence: Annotated[float, typer.Option(help="The least confidence of what counts, from 0 to 1.")] = 0.25,
    tiled: Annotated[
        bool | None,
        typer.Option("--tiled/--whole", help="As in `pavetwin detect`; unless given, as the model was trained."),
    ] = None,
    overview: Overview = False,
    gsd_mm: Annotated[
        float | None, typer.Option(help="Ground resolution of all photographs, as in --gsd-mm 2.7; for sizes.")
    ] = None,
    height_m: Annotated[
        float | None, typer.Option(help="Height of all photographs above the ground; else as they say.")
    ] = None,
    position_error_m: Annotated[
        float | None,
        typer.Option(help="Standard deviation of the positions; else as photographs say, or 0."),
    ] = None,
    fitted: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.json",
            help="Fitted sensor that tells how likely entries are defects; the one that ships for the detector "
            "unless given.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that holds something.")] = False,
) -> None:
    """List the defects that were detected, each once: place, class, severity and sizes with their errors.

    \b
    pavetwin inventory missions/monday/hover
    pavetwin inventory missions/monday/hover missions/tuesday/hover -o both
    pavetwin inventory photographs -o inventory
    pavetwin inventory photographs --model model.onnx -o inventory --gsd-mm 2.7
    pavetwin inventory photographs --model model.onnx -o inventory --height-m 12 --position-error-m 0.5

    Writes inventory.gpkg (for QGIS, with its style), inventory.geojson, inventory.csv, and crops with pages of them.
    """
    from pavetwin.inventory.files import write_inventory
    from pavetwin.inventory.listing import entries_of
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
        raise PaveTwinError("Say where the inventory of several missions goes with `output`.")
    target = output or source / "inventory"
    if target.exists() and (not target.is_dir() or any(target.iterdir())) and not force:
        raise PaveTwinError(f"`output` '{target}' exists and holds something; choose another folder, or add `force`.")
    with progress("Reading", lines=True) as tell:
        if (source / MISSION).is_file():
            from pavetwin.inventory.of_mission import flown, flown_together

            _refuse(
                model=model,
                gsd_mm=gsd_mm,
                height_m=height_m,
                tiled=tiled,
                overview=overview or None,
            )
            error_m = position_error_m or 0.0
            reading = (
                flown_together(sources, position_error_m=error_m, fitted=fitted)
                if others
                else flown(source, position_error_m=error_m, fitted=fitted)
            )
        else:
            inner = sorted(path.parent.name for path in source.glob(f"*/{MISSION}"))
            if inner:
                names = ", ".join(str(source / name) for name in inner)
                raise PaveTwinError(f"'{source}' holds a mission for each policy; name one: {names}.")
            reading = _photographs(
                source, target, model, confidence, tiled, overview, gsd_mm, height_m, position_error_m, fitted, tell
            )
        tell(1.0, "Writing")
        entries = entries_of(reading, confidence)
        files = write_inventory(entries, reading.frame, target)
    _tell(reading, len(reading.confident(confidence)), entries)
    has_crops = any((target / "crops").glob("*.jpg"))
    names = ", ".join([*(file.name for file in files), *(("crops/", "crops-01.jpg, …") if has_crops else ())])
    out.line(f"Results: {target} ({names})")


def _photographs(
    source: Path,
    output: Path,
    model: str | None,
    confidence: float,
    tiled: bool | None,
    overview: bool,
    gsd_mm: float | None,
    height_m: float | None,
    position_error_m: float | None,
    fitted: str | None,
    tell: "Callable[[float, str], None]",
) -> "Reading":
    from pavetwin.files import file_sha256
    from pavetwin.inventory.of_photographs import photographed
    from pavetwin.inventory.probability import entry_model
    from pavetwin.perception.inference import Detector

    file = named(model)
    sha256 = file_sha256(file)
    # What ships was fitted to looks without an overview, of which a share is right that is another.
    known = entry_model(sha256, fitted) if fitted or not overview else None
    detector = Detector(file, confidence=confidence, tiled=tiled, overview=overview)
    reading = photographed(
        detector,
        source,
        gsd_mm=gsd_mm,
        height_m=height_m,
        position_error_m=position_error_m,
        output=output,
        tell=tell,
    )
    return replace(reading, detector=sha256, entry_model=known)


def _refuse(**given: object) -> None:
    """Raises:
    PaveTwinError: an option for photographs is given with a mission.
    """
    for name, value in given.items():
        if value is not None:
            raise PaveTwinError(f"`{name}` is for photographs; a mission's own detections are listed without it.")


def _tell(reading: "Reading", observations: int, listed: "Sequence[Entry]") -> None:
    from collections import Counter

    from typer.main import get_group

    from pavetwin.cli import app
    from pavetwin.cli.flags import with_flags
    from pavetwin.inventory.condition import LIKELY
    from pavetwin.reports.words import counted

    kinds = [entry.kind for entry in listed]
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
        out.line(with_flags(remark, ["inventory"], get_group(app)))
