"""What the sources found: published counts, and the boxes of photographs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import polars as pl

from pavetwin.errors import PaveTwinError

CLASSES: Final = ("single_crack", "crocodile_crack", "pothole")
NAMES: Final = {"single_crack": "cracks", "crocodile_crack": "networks", "pothole": "potholes"}
RDD, PDD = "RDD2022", "UAV-PDD2023"

COUNTS: Final[Mapping[str, tuple[int, int, int]]] = {RDD: (2689, 293, 86), PDD: (10078, 603, 195)}
"""Boxes of cracks, networks and potholes in drones' photographs: the China drone subset of RDD2022 (Arya et al. 2022)
and UAV-PDD2023."""

DIRECTIONS: Final[Mapping[str, tuple[int, int, int]]] = {RDD: (1126, 1010, 0), PDD: (2994, 5398, 1686)}
"""Of their cracks along the street, across it, and oblique; RDD2022 has no oblique ones."""

POTHOLES_PER_KM: Final[Mapping[str, float]] = {
    "photographs of US streets (RoadBotics)": 2800 / 9144,
    "councils of England without London (ALARM 2007)": 3 / 1.609344,
    "counted on foot in Great Britain (AA Streetwatch 2012)": 6.25 / 1.609344,
    "London's councils (ALARM 2007)": 28 / 1.609344,
}

REPAIRED_M: Final = (0.04, 0.20)
"""Depth and width from which a council repairs a pothole (Suffolk County Council)."""

PDD_PIXELS_M: Final[Mapping[str, float]] = {
    **dict.fromkeys(("sample_01", "sample_06", "sample_08"), 0.011),
    **dict.fromkeys(("sample_02", "sample_03", "sample_04", "sample_07"), 0.0078),
}
"""Metres a pixel of samples of UAV-PDD2023, 1280 pixels wide, by the beginning of their names. Lanes tell it, taken for
3.75 m wide: 315 to 346 pixels in the first three (10.8 to 11.9 mm), 440 to 506 in the others (7.4 to 8.5 mm). In
sample_06 a car, taken for 4.7 m long, is 434 pixels without its shadow (10.8 mm). The other samples show neither."""

_CLASS_OF: Final = {
    **{"D00": "single_crack", "D10": "single_crack", "D20": "crocodile_crack", "D40": "pothole"},
    **dict.fromkeys(("Longitudinal crack", "Transverse crack", "Oblique crack"), "single_crack"),
    **{"Alligator crack": "crocodile_crack", "Pothole": "pothole"},
}
_CORNERS: Final = ("xmin", "ymin", "xmax", "ymax")


@dataclass(frozen=True, eq=False)
class Photographs:
    """The labels of photographs."""

    name: str
    images: int
    boxes: pl.DataFrame
    """Columns `image` (its file), `kind`, `xmin`, `ymin`, `xmax`, `ymax` (pixels), `cut`: whether the border cuts the
    box, and `pixel_m`: what a pixel of its photograph covers, where that is known."""
    side_px: int
    """Of the shorter side of a photograph."""

    @property
    def measured(self) -> pl.DataFrame:
        """The boxes in photographs whose ground resolution is known; all where none is."""
        known = self.boxes.drop_nulls("pixel_m")
        return known if known.height else self.boxes

    @property
    def known_pixels_m(self) -> list[float]:
        """The ground resolutions that are known, in order."""
        return sorted(self.boxes["pixel_m"].drop_nulls().unique())


def rdd2022(folder: Path) -> Photographs:
    """The China drone subset of RDD2022; `folder` is its `train`, with `images` and `annotations/xmls`.

    Raises:
        PaveTwinError: there are no annotations.
    """
    files = sorted((folder / "annotations" / "xmls").glob("*.xml"))
    _check(files, folder, "annotations/xmls/*.xml of RDD2022's China drone subset")
    images = [folder / "images" / f"{file.stem}.jpg" for file in files]
    return Photographs(RDD, len(files), _boxes(files, images, (512, 512)), 512)


def uav_pdd2023(folder: Path) -> Photographs:
    """Samples of UAV-PDD2023 of 1280 × 960 pixels, with `annotations`.

    Raises:
        PaveTwinError: there are no annotations.
    """
    files = sorted((folder / "annotations").glob("*_annotation.xml"))
    _check(files, folder, "annotations/*_annotation.xml of UAV-PDD2023")
    images = [folder / f"{file.stem.removesuffix('_annotation')}.jpg" for file in files]
    return Photographs(PDD, len(files), _boxes(files, images, (1280, 960)), 960)


def _check(files: list[Path], folder: Path, what: str) -> None:
    if not files:
        raise PaveTwinError(f"'{folder}' has no {what}.")


def _boxes(files: list[Path], images: list[Path], size_px: tuple[int, int]) -> pl.DataFrame:
    rows = []
    for file, image in zip(files, images, strict=True):
        pixel_m = next((size for name, size in PDD_PIXELS_M.items() if image.name.startswith(name)), None)
        for thing in ElementTree.parse(file).getroot().iter("object"):
            kind = _CLASS_OF.get(thing.findtext("name", ""))
            if kind is not None:
                corners = [float(thing.findtext(f"bndbox/{name}", "nan")) for name in _CORNERS]
                inside = min(corners) > 1 and corners[2] < size_px[0] - 2 and corners[3] < size_px[1] - 2
                rows.append((str(image), kind, *corners, not inside, pixel_m))
    columns = {"image": pl.String, "kind": pl.String, **dict.fromkeys(_CORNERS, pl.Float64)}
    return pl.DataFrame(rows, schema={**columns, "cut": pl.Boolean, "pixel_m": pl.Float64}, orient="row")
