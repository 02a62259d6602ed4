"""The condition index by an inventory: from detected defects and their measured sizes, right or wrong."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pavetwin.inventory.of_mission import reported
from pavetwin.inventory.reading import Reading, entries_of
from pavetwin.mission.condition import ConditionReport
from pavetwin.mission.result import MissionResult
from pavetwin.pci import SampleUnit, UnitCondition, mean_pci, measured_conditions, sample_units
from pavetwin.world.georeference import GeoReference


def with_detected(report: ConditionReport, reading: Reading) -> ConditionReport:
    """The report with the condition that the sensor's measurements give; unchanged where it measured nothing."""
    units = [condition.unit for condition in report.true]
    return replace(report, detected=detected_conditions(units, reading, report.world.georeference))


def detected_conditions(
    units: Sequence[SampleUnit], reading: Reading, place: GeoReference
) -> tuple[UnitCondition, ...] | None:
    """The condition of units by the detections of a sensor that measures sizes; without distress if it has none.

    Args:
        place: frame of the world.

    Returns:
        None where no detection is measured, or there is none and the sensor measures no sizes.
    """
    if not reading.is_measured:
        return None
    if len(reading.detections):
        if reading.frame is None:
            return None
        if reading.frame != place:
            raise ValueError("the detections are not in the frame of the world")
    return measured_conditions(units, (entry for entry in entries_of(reading) if entry.is_likely))


def detected_of_segments(result: MissionResult) -> Mapping[str, float]:
    """The condition index of each inspected segment of a mission, by its id, from the sensor's detections and sizes,
    right or wrong; empty where no size was measured.

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
