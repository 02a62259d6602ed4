"""The condition index by an inventory: of what was detected, with the sizes that were measured, right or wrong."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import pi, sqrt
from typing import Final

from shapely import Polygon

from pavetwin.detections import possible_severities
from pavetwin.inventory.entry import Entry
from pavetwin.inventory.of_mission import reported
from pavetwin.inventory.reading import Reading, entries_of
from pavetwin.mission.condition import ConditionReport
from pavetwin.mission.result import MissionResult
from pavetwin.pci import MeasuredDefect, SampleUnit, UnitCondition, mean_pci, measured_conditions, sample_units
from pavetwin.sensing.fitted_sensor import EntryModel
from pavetwin.world.georeference import GeoReference
from pavetwin.world.model import Severity
from pavetwin.world.rectangles import smallest_rectangle

LIKELY: Final = 0.5
"""Probability from which an entry counts as a defect."""

_EVERY: Final = tuple(Severity)


def with_detected(report: ConditionReport, reading: Reading) -> ConditionReport:
    """The report with the condition by what a sensor measured; as it is where it measured nothing."""
    units = [condition.unit for condition in report.true]
    return replace(report, detected=detected_conditions(units, reading, report.world.georeference))


def detected_conditions(
    units: Sequence[SampleUnit], reading: Reading, place: GeoReference
) -> tuple[UnitCondition, ...] | None:
    """The condition of units by what a sensor that measures sizes reported of them; without distress where it reported
    nothing.

    Args:
        place: of the world.

    Returns:
        None where none of what it reported was measured, or it reported nothing and measures none.
    """
    if not reading.is_measured:
        return None
    if len(reading.detections):
        if reading.frame is None:
            return None
        if reading.frame != place:
            raise ValueError("the detections are not in the frame of the world")
    return measured_conditions(units, measured_defects(entries_of(reading), reading.entry_model))[0]


def detected_of_segments(result: MissionResult) -> Mapping[str, float]:
    """The condition index of each segment that a mission inspected, by its id, from what its sensor detected and
    measured, right or wrong; empty where it measured nothing of what it reported.

    Args:
        result: of a sensor that measures sizes (`pavetwin.sensing.Sensor.measures_sizes`).
    """
    world = result.environment.world
    units = sample_units(world.segment(row.segment) for row in result.rows)
    conditions = detected_conditions(units, reported(result), world.georeference)
    of_segment: dict[str, list[UnitCondition]] = {}
    for condition in conditions or ():
        of_segment.setdefault(condition.unit.segment.id, []).append(condition)
    return {segment: mean_pci(mine) for segment, mine in of_segment.items()}


def measured_defects(entries: Sequence[Entry], model: EntryModel | None = None) -> Iterator[MeasuredDefect]:
    """Entries with an outline, as the condition index counts them: those that are more likely a defect than not, where
    their probability is known.

    Where images leave the severity open, all that they allow count in part: by how frequent they are among the defects
    that the sensor was fitted to, or else equally. A size that they do not show is that of the outline.

    Args:
        model: that gave them their probabilities.
    """
    for entry in entries:
        if entry.outline is not None and (entry.probability is None or entry.probability >= LIKELY):
            yield _measured(entry, entry.outline, model)


def _measured(entry: Entry, outline: Polygon, model: EntryModel | None) -> MeasuredDefect:
    sizes = {name: estimate.value for name, estimate in entry.sizes.items()}
    area_m2 = sizes.get("area_m2", outline.area)
    diameter_mm = sizes.get("diameter_mm")
    return MeasuredDefect(
        kind=entry.class_name,
        outline=outline,
        severities=_severities(entry, model),
        length_m=sizes.get("length_m", _longer_side_m(outline)),
        width_m=2 * sqrt(area_m2 / pi) if diameter_mm is None else diameter_mm / 1000,
        area_m2=area_m2,
    )


def _severities(entry: Entry, model: EntryModel | None) -> dict[Severity, float]:
    """The part that counts of each severity: of `low to medium` both; of all where nothing is said."""
    ranks = possible_severities(entry.severity) or range(len(_EVERY))
    first, last = ranks[0], ranks[-1]
    shares = (1.0,) * len(_EVERY) if model is None else model.severities.get(entry.class_name, (1.0,) * len(_EVERY))
    allowed = shares[first : last + 1]
    if not sum(allowed):
        allowed = (1.0,) * len(allowed)
    return {severity: share / sum(allowed) for severity, share in zip(_EVERY[first : last + 1], allowed, strict=True)}


def _longer_side_m(outline: Polygon) -> float:
    around = smallest_rectangle(outline)
    return 0.0 if around is None else around.length
