"""The files of a handover, all or none."""

import shutil
import zipfile
from base64 import b64encode
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from pavetwin.draw import style
from pavetwin.draw.condition_maps import RATING_COLOURS
from pavetwin.draw.extent import credit
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing_folder
from pavetwin.flightplan import PlanFormat, save_plan
from pavetwin.geo_files import load_pyogrio
from pavetwin.handover.contents import Handover
from pavetwin.handover.map import map_figure
from pavetwin.handover.page import Page, page_of
from pavetwin.handover.sheet import sheet_figure
from pavetwin.inventory.files import write_inventory
from pavetwin.inventory.reading import entries_of
from pavetwin.mission.condition import write_units
from pavetwin.reports.page import render
from pavetwin.world.layers import LayerStyle, Symbol, columns_of, write_layer, write_styles

_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of the workbook's parts, the earliest of the format: the same tables give the same bytes."""


def write_workbook(sheets: Mapping[str, pl.DataFrame], path: Path) -> None:
    """Write tables as sheets of a new file, in their order. Text stays text; a missing value is an empty cell.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    pyogrio = load_pyogrio()
    path.unlink(missing_ok=True)
    try:
        for name, table in sheets.items():
            values, empty = columns_of(table)
            pyogrio.raw.write(
                path,
                geometry=None,
                field_data=list(values.values()),
                fields=np.array(list(values), dtype=object),
                field_mask=[empty.get(column) for column in values],
                layer=name,
                driver="XLSX",
                geometry_type=None,
                crs=None,
                append=path.exists(),
            )
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, RuntimeError) as error:
        raise OSError(f"{path.name} could not be written ({error})") from error
    _fix_dates(path)


def _fix_dates(path: Path) -> None:
    packed = BytesIO()
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as target:
        for part in source.infolist():
            target.writestr(zipfile.ZipInfo(part.filename, _FIRST_DATE), source.read(part), zipfile.ZIP_DEFLATED)
    path.write_bytes(packed.getvalue())


PAGE: Final = "handover.html"
SHEET: Final = "handover.pdf"
MAP: Final = "map.png"
GEOPACKAGE: Final = "handover.gpkg"
WORKBOOK: Final = "handover.xlsx"
PLANS: Final = "plan"
MISSION: Final = "mission"
INVENTORY: Final = "inventory"

HANDOVER_FILES: Final = (SHEET, PAGE, MAP, "defects.csv", "units.csv", "streets.csv", GEOPACKAGE, WORKBOOK)
"""Files of every handover; the plans are in a folder next to them."""


STYLES: Final[Mapping[str, LayerStyle]] = {
    "defects": LayerStyle("outcome", {name: style.OUTCOME_COLOURS[name] for name in ("found", "missed")}, Symbol.AREA),
    "sample_units": LayerStyle(
        "rating_found", {rating.value: colour for rating, colour in RATING_COLOURS.items()}, Symbol.AREA, opacity=0.6
    ),
}
"""Styles of the GeoPackage's layers."""


def check_target(folder: Path, *, force: bool) -> None:
    """Check that a handover may be written into a folder.

    Raises:
        PaveTwinError: the folder is a file, or holds something: no handover, or one that `force` does not let replace.
    """
    if folder.exists() and not folder.is_dir():
        raise PaveTwinError(f"`output` {folder}: it is a file; name a folder.")
    if not folder.exists() or not any(folder.iterdir()):
        return
    if not all((folder / name).is_file() for name in (PAGE, SHEET)):
        raise PaveTwinError(f"`output` '{folder}' exists and holds no handover; choose another folder.")
    if not force:
        raise PaveTwinError(f"`output` '{folder}' holds a handover; choose another folder, or replace it (`force`).")


def write_handover(
    handover: Handover,
    folder: Path,
    formats: Sequence[PlanFormat],
    *,
    force: bool = False,
    with_mission: bool = False,
) -> list[str]:
    """Write all files into a folder, or none.

    Args:
        formats: of the plans, a file for each flight and format.
        with_mission: copy the mission's own folder into it as well.
        force: replace an existing handover.

    Returns:
        The names of the plans, in the folder `plan`.

    Raises:
        PaveTwinError: as `check_target`, the mission's table of detections is damaged, a format cannot hold the plan,
            or the folder cannot be written.
    """
    check_target(folder, force=force)
    with writing_folder(folder, replace=True) as temporary:
        plans = save_plan(handover.plan, temporary / PLANS, formats)
        if with_mission:
            shutil.copytree(handover.mission.folder, temporary / MISSION)
        if handover.measured:
            write_inventory(entries_of(handover.reading), handover.reading, temporary / INVENTORY)
        handover.defects.write_csv(temporary / "defects.csv")
        handover.units.write_csv(temporary / "units.csv")
        handover.streets.write_csv(temporary / "streets.csv")
        _write_geopackage(handover, temporary / GEOPACKAGE)
        sheets = {"defects": handover.defects, "sample units": handover.units, "streets": handover.streets}
        write_workbook(sheets, temporary / WORKBOOK)
        page = page_of(handover, credit(handover.world) or "")
        with style.styled():
            style.save_figure(sheet_figure(page, handover), temporary / SHEET)
            style.save_figure(map_figure(handover, page.credit), temporary / MAP)
        picture = (temporary / MAP).read_bytes()
        others = [f"{name}/" for name in (INVENTORY, MISSION) if (temporary / name).is_dir()]
        html = _html(page, picture, [path.name for path in plans], others)
        (temporary / PAGE).write_text(html, encoding="utf-8")
    return [path.name for path in plans]


def _write_geopackage(handover: Handover, path: Path) -> None:
    """The layers `defects` and `sample_units`, in the world's coordinate system, with the styles that QGIS opens them
    in: found or missed, and the condition as found."""
    columns, masks = columns_of(handover.defects)
    outlines = [defect.polygon for defect in handover.shapes]
    write_layer(path, "defects", "Polygon", outlines, columns, handover.world.georeference, masks)
    write_units(handover.condition, handover.units, path)
    write_styles(path, STYLES)


def _html(page: Page, picture: bytes, plans: Sequence[str], folders: Sequence[str]) -> str:
    return render(
        "pavetwin.handover",
        "handover.html.jinja",
        page=page,
        picture=b64encode(picture).decode("ascii"),
        plans=plans,
        files=[*HANDOVER_FILES, *folders],
    )
