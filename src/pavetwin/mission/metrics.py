"""The metrics of a mission, segment by segment. Definitions: docs/explanation/definitions.md."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from pavetwin._core import Flight
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.sensing import Outcome
from pavetwin.twin import InspectionMemory


@dataclass(frozen=True, slots=True)
class SegmentMetrics:
    """The metrics of one segment of a mission. A metric that is undefined is None."""

    order: int
    segment: str
    street: str
    length_m: float
    area_m2: float
    defects: int
    swept: int
    """Defects whose centre the window passed over."""
    confirmed: int
    recovered: int
    """Confirmed first during a revisit."""
    coverage: float | None
    swath_coverage: float | None
    recovery: float | None
    surface_coverage: float
    permanently_hidden: float
    """Share of the cells that no capture of the planned passes can see because of parked vehicles."""
    inspected: bool
    start_s: float
    end_s: float
    time_s: float
    energy: float
    wait_s: float
    distance_m: float
    occlusions: int
    revisits: int
    swaps: int
    duplicates: int
    """Detections of defects that were confirmed already."""
    false_alarms: int
    """Detections of nothing."""
    precision: float | None
    """Detections that match a defect, as a share of those and the false alarms."""
    false_alarms_per_100_m2: float | None
    """Of the surface that was seen."""
    pci: float
    """Pavement Condition Index (ASTM D6433) of the segment."""
    pci_found: float
    """What it would be if nothing were there but the confirmed defects."""
    pci_error: float
    """The latter less the former, in points."""


class SegmentMeter:
    """Reads the kernel's counters when a segment is opened and when it is closed.

    A segment begins where the one before it ended, so that times and energies add up to the mission's.
    """

    def __init__(self, environment: MissionEnvironment) -> None:
        self._environment = environment
        self._last: dict[str, Any] = {
            **{"time_s": 0.0, "energy": 0.0, "wait_s": 0.0, "distance_m": 0.0},
            **{"occlusions": 0, "swaps": 0},
        }
        self._judged = Counter[Outcome]()

    def close(
        self,
        order: int,
        target: int,
        flight: Flight,
        memory: InspectionMemory,
        revisits: int,
        outcomes: Counter[Outcome],
        *,
        permanently_hidden: float,
        inspected: bool,
        swaps: int,
    ) -> SegmentMetrics:
        """The row of a segment that has just ended.

        Args:
            outcomes: of all detections of the mission so far.
        """
        segment = self._environment.world.segments[target]
        now = {
            **{"time_s": flight.time_s, "energy": flight.energy_used, "wait_s": flight.waited_s},
            **{"distance_m": flight.distance_m, "occlusions": flight.occlusions, "swaps": swaps},
        }
        before, self._last = self._last, now
        defects = self._environment.defects_by_segment.get(segment.id, ())
        swept_flags = flight.swept()
        swept = sum(bool(swept_flags[defect]) for defect in defects)
        found = [memory.confirmed[defect] for defect in defects if defect in memory.confirmed]
        recovered = sum(confirmation.on_revisit for confirmation in found)
        here, self._judged = outcomes - self._judged, outcomes
        matched = here[Outcome.CONFIRMED] + here[Outcome.DUPLICATE]
        false_alarms = here[Outcome.FALSE_ALARM]
        surface_coverage = flight.surface_coverage(target)
        seen_m2 = surface_coverage * segment.area_m2
        survey = self._environment.survey_of(segment)
        pci, pci_found = survey.pci(), survey.pci(defect for defect in defects if defect in memory.confirmed)
        return SegmentMetrics(
            order=order,
            segment=segment.id,
            street=segment.street_name,
            length_m=segment.length_m,
            area_m2=segment.area_m2,
            defects=len(defects),
            swept=swept,
            confirmed=len(found),
            recovered=recovered,
            coverage=len(found) / len(defects) if defects else None,
            swath_coverage=len(found) / swept if swept else None,
            recovery=recovered / swept if swept else None,
            surface_coverage=surface_coverage,
            permanently_hidden=permanently_hidden,
            inspected=inspected,
            start_s=before["time_s"],
            end_s=now["time_s"],
            **{name: value - before[name] for name, value in now.items()},
            revisits=revisits,
            duplicates=here[Outcome.DUPLICATE],
            false_alarms=false_alarms,
            precision=matched / (matched + false_alarms) if matched + false_alarms else None,
            false_alarms_per_100_m2=100 * false_alarms / seen_m2 if seen_m2 else None,
            pci=pci,
            pci_found=pci_found,
            pci_error=pci_found - pci,
        )
