"""A workbook for spreadsheet programs (XLSX), written by GDAL: a sheet for each table."""

import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
import polars as pl

from pavetwin import geo_files
from pavetwin.world.layers import columns_of

_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
"""Of the workbook's parts: the earliest that the format knows, so that the same tables give the same bytes."""


def write_workbook(sheets: Mapping[str, pl.DataFrame], path: Path) -> None:
    """Write tables as sheets of a new file, in their order. Text stays text; a missing value is an empty cell.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    pyogrio = geo_files.pyogrio()
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
