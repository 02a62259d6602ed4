"""The condition index by an inventory: of what was detected, with the sizes that were measured, right or wrong."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import pi, sqrt
from typing import Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.inventory.entry import SEVERITIES, Entry
from pavetwin.inventory.listing import entries_of
from pavetwin.inventory.reading import Reading
from pavetwin.mission.condition import ConditionReport
from pavetwin.pci import MeasuredDefect, measured_conditions
from pavetwin.world.georeference import GeoReference, from_wgs84
from pavetwin.world.model import Severity

_EVERY: Final = tuple(Severity)


def with_detected(report: ConditionReport, reading: Reading) -> ConditionReport:
    """The report with the condition by what a sensor measured; as it is where it measured nothing."""
    if reading.frame is None or not any(each.sizes for each in reading.observations):
        return report
    units = [condition.unit for condition in report.true]
    defects = measured_defects(entries_of(reading), reading.frame, report.world.georeference)
    return replace(report, detected=measured_conditions(units, defects)[0])


def measured_defects(entries: Sequence[Entry], frame: GeoReference, place: GeoReference) -> Iterator[MeasuredDefect]:
    """Entries with an outline, as the condition index counts them.

    Where images leave the severity open, all that they allow count in equal parts. A size that they do not show is that
    of the outline.

    Args:
        frame: of the entries.
        place: of the world.
    """
    for entry in entries:
        if entry.outline is not None:
            outline = shapely.transform(entry.outline, lambda xy: from_wgs84(place, frame.to_wgs84(xy)))
            yield _measured(entry, outline)


def _measured(entry: Entry, outline: Polygon) -> MeasuredDefect:
    sizes = {name: estimate.value for name, estimate in entry.sizes.items()}
    area_m2 = sizes.get("area_m2", outline.area)
    diameter_mm = sizes.get("diameter_mm")
    return MeasuredDefect(
        kind=entry.kind.lower().replace(" ", "_"),
        outline=outline,
        severities=_severities(entry.severity),
        length_m=sizes.get("length_m", _longer_side_m(outline)),
        width_m=2 * sqrt(area_m2 / pi) if diameter_mm is None else diameter_mm / 1000,
        area_m2=area_m2,
    )


def _severities(text: str) -> tuple[Severity, ...]:
    """`low to medium` as both; all where nothing is said."""
    ends = [SEVERITIES.index(word) for word in text.split(" to ") if word in SEVERITIES]
    return _EVERY[min(ends) : max(ends) + 1] if ends else _EVERY


def _longer_side_m(outline: Polygon) -> float:
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(outline))
    return float(np.hypot(*np.diff(corners, axis=0).T).max(initial=0.0))
