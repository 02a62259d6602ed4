"""The files of an inventory: a table, crops of the images, and for known places a GeoPackage and GeoJSON."""

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.detections import SIZES, Detections
from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.inventory.entry import Entry
from pavetwin.inventory.reading import Reading
from pavetwin.labels.class_names import display_name
from pavetwin.labels.classes import categories, category_colours
from pavetwin.world.georeference import GeoReference
from pavetwin.world.layers import LayerStyle, Symbol, write_layer, write_styles

A_PAGE: Final = 24
"""Crops on a page."""

_QUALITY: Final = 88


def _write_crops(
    entries: Sequence[Entry], folder: Path, crop: Callable[[Detections], UInt8Array | None]
) -> dict[int, str]:
    """Write the crop of each entry whose image is available, and pages of them; returns the names by entry number.

    Args:
        crop: the part of an image around a detection (`Reading.crop`).

    Raises:
        PaveTwinError: a file cannot be written.
    """
    names: dict[int, str] = {}
    cells: list[Image.Image] = []
    for entry in entries:
        image = _crop(entry, crop)
        if image is None:
            continue
        names[entry.number] = f"crops/{entry.number:04}.jpg"
        with writing(folder / names[entry.number]) as temporary:
            image.save(temporary, "JPEG", quality=_QUALITY)
        cells.append(_cell(entry, image))
    named = sorted({display_name(entry.class_name) for entry in entries if entry.number in names})
    colour_of = {name: colour for name, colour in category_colours().items() if name in named}
    for start, page in zip(range(0, len(cells), A_PAGE), _page_names(len(cells)), strict=True):
        shown = cells[start : start + A_PAGE]
        title = f"Inventory   {start + 1} to {start + len(shown)} of {len(cells)} entries with an image"
        with writing(folder / page) as temporary:
            assembled(shown, title, colour_of, ignored="").save(temporary, "JPEG", quality=_QUALITY)
    return names


def _page_names(crops: int) -> list[str]:
    """Files of the pages of so many crops."""
    return [f"crops-{page + 1:02}.jpg" for page in range(-(-crops // A_PAGE))]


def _crop(entry: Entry, crop: Callable[[Detections], UInt8Array | None]) -> Image.Image | None:
    try:
        pixels = crop(entry.best)
    except PaveTwinError:  # the image is missing or damaged since it was searched
        return None
    return None if pixels is None else Image.fromarray(pixels)


def _cell(entry: Entry, image: Image.Image) -> Image.Image:
    size = entry.sizes.get("length_m") or entry.sizes.get("area_m2")
    unit = "m" if "length_m" in entry.sizes else "m²"
    words = [f"{size.value:.2f} ± {size.error:.2f} {unit}"] if size else []
    words += [entry.severity] if entry.severity else []
    looks = f"{entry.looks} look{'s' * (entry.looks != 1)}"
    text = ", ".join([*words, looks])
    sure = f"confidence {entry.confidence:.2f}"
    if entry.probability is not None:
        sure += f", a defect: {100 * entry.probability:.0f} %"
    return captioned(image.resize((CELL_PX, CELL_PX)), f"{entry.number}: {display_name(entry.class_name)}", text, sure)


_COLOURS: Final = {
    category.name: category_colours()[category.name] for category in categories() if category.supercategory == "defect"
}

STYLES: Final[Mapping[str, LayerStyle]] = {
    "defects": LayerStyle("class", _COLOURS, Symbol.DOT),
    "outlines": LayerStyle("class", _COLOURS, Symbol.OUTLINE),
}
"""Keyed by layer."""


TABLE: Final = "inventory.csv"
GEOPACKAGE: Final = "inventory.gpkg"
GEOJSON: Final = "inventory.geojson"

_DIGITS: Final = {"area_m2": 4, "length_m": 3, "mean_width_mm": 1, "diameter_mm": 1}

_SIDES: Final = ("left", "top", "right", "bottom")

_TEXTS: Final = ("class", "severity", "image", "crop")
COLUMNS: Final = (
    *("id", "class", "severity"),
    *(column for name in SIZES for column in (name, f"{name}_error")),
    *(
        "is_cut",
        "confidence",
        "probability",
        "looks",
        "longitude",
        "latitude",
        "position_error_m",
        "image",
        *_SIDES,
        "crop",
    ),
)
"""Columns of every file."""

_WHOLE: Final = ("id", "looks")
_FLAGS: Final = ("is_cut",)


def write_inventory(entries: Sequence[Entry], reading: Reading, folder: Path) -> tuple[Path, ...]:
    """Write all files of an inventory; returns those that are not crops. A former inventory in the folder is removed.

    Args:
        reading: source of the entries.

    Raises:
        PaveTwinError: a file cannot be written.
    """
    former = _files_of(folder) if (folder / TABLE).is_file() else set()
    frame, crops = reading.frame, _write_crops(entries, folder, reading.crop)
    rows = [_row(entry, frame, crops.get(entry.number, "")) for entry in entries]
    with writing(folder / TABLE) as temporary:
        temporary.write_text(_csv(rows), encoding="utf-8")
    written = [folder / TABLE]
    placed = [at for at, entry in enumerate(entries) if entry.place is not None]
    if frame is not None and placed:
        kept = [rows[at] for at in placed]
        with writing(folder / GEOPACKAGE) as temporary:
            _write_geopackage([entries[at] for at in placed], kept, frame, temporary)
        with writing(folder / GEOJSON) as temporary:
            temporary.write_text(_geojson(kept), encoding="utf-8")
        written += [folder / GEOPACKAGE, folder / GEOJSON]
    pages = (folder / name for name in _page_names(len(crops)))
    for path in former.difference(written, pages, (folder / name for name in crops.values())):
        path.unlink(missing_ok=True)
    return tuple(written)


def _files_of(folder: Path) -> set[Path]:
    """Files that an inventory may have written into a folder."""
    patterns = (GEOPACKAGE, GEOJSON, "crops/[0-9][0-9][0-9][0-9]*.jpg", "crops-[0-9][0-9]*.jpg")
    return {path for pattern in patterns for path in folder.glob(pattern)}


def _row(entry: Entry, frame: GeoReference | None, crop: str) -> dict[str, Any]:
    """An entry by `COLUMNS`."""
    sizes: dict[str, float | None] = {}
    for name in SIZES:
        estimate = entry.sizes.get(name)
        sizes[name] = None if estimate is None else round(estimate.value, _DIGITS[name])
        sizes[f"{name}_error"] = None if estimate is None else round(estimate.error, _DIGITS[name] + 1)
    lonlat = (
        (None, None)
        if entry.place is None or frame is None
        else tuple(round(float(angle), 8) for angle in frame.to_wgs84((entry.place.x, entry.place.y)))
    )
    box = [None if np.isnan(edge) else edge for edge in entry.best.box_px[0].tolist()]
    return {
        "id": entry.number,
        "class": display_name(entry.class_name),
        "severity": entry.severity,
        **sizes,
        "is_cut": entry.is_cut,
        "confidence": round(entry.confidence, 4),
        "probability": None if entry.probability is None else round(entry.probability, 4),
        "looks": entry.looks,
        "longitude": lonlat[0],
        "latitude": lonlat[1],
        "position_error_m": None if entry.place_error_m is None else round(entry.place_error_m, 3),
        "image": entry.best.image[0],
        **{side: None if at is None else round(at, 1) for side, at in zip(_SIDES, box, strict=True)},
        "crop": crop,
    }


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _geojson(rows: Sequence[Mapping[str, Any]]) -> str:
    features = [
        {
            "type": "Feature",
            "id": row["id"],
            "geometry": {"type": "Point", "coordinates": [row["longitude"], row["latitude"]]},
            "properties": {name: value for name, value in row.items() if name not in ("longitude", "latitude")},
        }
        for row in rows
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, ensure_ascii=False, indent=1) + "\n"


def _write_geopackage(
    entries: Sequence[Entry], rows: Sequence[Mapping[str, Any]], frame: GeoReference, path: Path
) -> None:
    """The layers `defects` (places) and `outlines` (of the best look), each with the style that QGIS opens it in."""
    columns = {name: _column(name, rows) for name in rows[0]}
    masks = {name: np.array([row[name] is None for row in rows]) for name in rows[0] if name not in _TEXTS}
    write_layer(path, "defects", "Point", [entry.place for entry in entries if entry.place], columns, frame, masks)
    outlines = [entry.outline for entry in entries if entry.outline]
    write_layer(path, "outlines", "Polygon", outlines, columns, frame, masks)
    write_styles(path, STYLES)


def _column(name: str, rows: Sequence[Mapping[str, Any]]) -> "np.ndarray[Any, Any]":
    values = [row[name] for row in rows]
    if name in _TEXTS:
        return np.array(values, dtype=object)
    if name in _FLAGS:
        return np.array(values, dtype=np.bool_)
    plain = [0 if value is None else value for value in values]
    return np.array(plain, dtype=np.int64 if name in _WHOLE else np.float64)
