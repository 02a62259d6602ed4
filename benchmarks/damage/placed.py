"""The defects of worlds in the frames of their streets: where they lie, how large they are, and in which direction."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from pavetwin.world.model import Defect, Segment
from pavetwin.world.segments import direction_at


@dataclass(frozen=True, eq=False)
class Placed:
    """Segments and the defects on them."""

    segments: pl.DataFrame
    """A row a segment: `at` (its number), `town`, `street`, `length_m`, `width_m`, `area_m2`, `lanes`."""
    defects: pl.DataFrame
    """A row a defect: `at` (of its segment), `kind`, `severity`, `station_m` along the street and `offset_m` to the
    left of its middle, `turn_deg` from its direction (0 … 90), `along_m` and `across_m` of the box around its outline,
    `width_m`, `depth_m`, `area_m2`, `is_notched` where another one lies within it."""

    def of(self, kind: str) -> pl.DataFrame:
        return self.defects.filter(pl.col("kind") == kind)


def placed(towns: Sequence[tuple[str, Sequence[Segment], Sequence[Defect]]]) -> Placed:
    """The defects of several towns: the name, segments and defects of each."""
    segments: list[dict[str, Any]] = []
    defects: list[dict[str, Any]] = []
    for town, streets, damage in towns:
        first = len(segments)
        segments += [
            {
                "at": first + number,
                "town": town,
                "street": f"{town} {segment.street}",
                "length_m": segment.length_m,
                "width_m": segment.width_m,
                "area_m2": segment.area_m2,
                "lanes": max(1, segment.lanes),
            }
            for number, segment in enumerate(streets)
        ]
        defects += _rows(streets, damage, first)
    return Placed(pl.DataFrame(segments), pl.DataFrame(defects))


def _rows(segments: Sequence[Segment], defects: Sequence[Defect], first: int) -> Iterator[dict[str, Any]]:
    number_of = {segment.id: number for number, segment in enumerate(segments)}
    for defect in defects:
        number = number_of[defect.segment]
        line = segments[number].centre_line
        station = float(line.project(defect.centre))
        dx, dy = direction_at(line, station)
        middle = line.interpolate(station)
        corners = np.asarray(defect.polygon.exterior.coords)
        along, across = corners @ np.array([dx, dy]), corners @ np.array([-dy, dx])
        turn = math.degrees(defect.yaw_rad - math.atan2(dy, dx)) % 180
        yield {
            "at": first + number,
            "kind": defect.kind,
            "severity": defect.severity.value,
            "station_m": station,
            "offset_m": (defect.centre.y - middle.y) * dx - (defect.centre.x - middle.x) * dy,
            "turn_deg": min(turn, 180 - turn),
            "along_m": float(np.ptp(along)),
            "across_m": float(np.ptp(across)),
            "width_m": defect.width_m,
            "depth_m": defect.depth_m,
            "area_m2": defect.polygon.area,
            "is_notched": bool(defect.notch),
        }
