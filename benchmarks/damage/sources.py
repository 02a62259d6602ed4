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

COUNTS: Final[Mapping[str, tuple[int, int, int]]] = {"RDD2022": (2689, 293, 86), "UAV-PDD2023": (10078, 603, 195)}
"""Boxes of cracks, networks and potholes in drones' photographs: the China drone subset of RDD2022 (Arya et al. 2022)
and UAV-PDD2023."""

DIRECTIONS: Final[Mapping[str, tuple[int, int, int]]] = {"RDD2022": (1126, 1010, 0), "UAV-PDD2023": (2994, 5398, 1686)}
"""Of their cracks along the street, across it, and oblique; RDD2022 has no oblique ones."""

POTHOLES_PER_KM: Final[Mapping[str, float]] = {
    "photographs of US streets, each of 3 m (RoadBotics)": 2800 / 9144,
    "councils of England without London (ALARM 2007)": 3 / 1.609344,
    "counted on foot in Great Britain (AA Streetwatch 2012)": 6.25 / 1.609344,
    "London's councils (ALARM 2007)": 28 / 1.609344,
}

REPAIRED_M: Final = (0.04, 0.20)
"""Depth and width from which a council repairs a pothole (Suffolk County Council)."""

SIDE_PX: Final = 512
"""Of the photographs of RDD2022's China drone subset."""

CLASS_OF: Final = {"D00": "single_crack", "D10": "single_crack", "D20": "crocodile_crack", "D40": "pothole"}
_CORNERS: Final = ("xmin", "ymin", "xmax", "ymax")


@dataclass(frozen=True)
class Photographs:
    """The labels of photographs."""

    images: int
    boxes: pl.DataFrame
    """Columns `image`, `kind`, `xmin`, `ymin`, `xmax`, `ymax` (pixels), and `cut`: whether the border cuts the box."""


def photographs(folder: Path) -> Photographs:
    """The boxes of RDD2022's China drone subset; `folder` holds its `annotations/xmls`.

    Raises:
        PaveTwinError: there are none.
    """
    files = sorted((folder / "annotations" / "xmls").glob("*.xml"))
    if not files:
        raise PaveTwinError(f"'{folder}' has no annotations/xmls/*.xml of RDD2022's China drone subset.")
    rows = []
    for file in files:
        for thing in ElementTree.parse(file).getroot().iter("object"):
            kind = CLASS_OF.get(thing.findtext("name", ""))
            if kind is not None:
                corners = [float(thing.findtext(f"bndbox/{name}", "nan")) for name in _CORNERS]
                cut = min(corners) <= 1 or max(corners) >= SIDE_PX - 2
                rows.append((file.stem, kind, *corners, cut))
    return Photographs(len(files), pl.DataFrame(rows, schema=["image", "kind", *_CORNERS, "cut"], orient="row"))
