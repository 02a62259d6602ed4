"""Metrics of a mission by segment, its totals, and the uncertainty of the share of defects found.

The interval of that share is that of Korn and Graubard (Confidence intervals for proportions with small expected number
of positive counts estimated from survey data, Survey Methodology 24, 1998): Clopper and Pearson's for as many
independent defects as would have the variance observed between streets,

    n_eff = p (1 − p) / v · (t(N − 1) / t(df))²,   at most the N defects that exist.

Few streets determine that variance v poorly, and not at all if every defect was found. It is therefore pooled with a
prior variance, that of defects of one street correlated by `ALIKE`, weighted by `WEIGHT` degrees of freedom; both are
assumptions of ours. The prior is left out where it would shorten the interval. docs/explanation/statistics.md gives
the coverage of these intervals in simulations. Definitions: docs/explanation/definitions.md.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from pavetwin._core import Flight
from pavetwin.arrays import Float64Array
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.sensing import Outcome
from pavetwin.twin import InspectionMemory
from pavetwin.world.model import Segment


@dataclass(frozen=True, slots=True)
class SegmentMetrics:
    """Metrics of one segment of a mission. An undefined metric is None."""

    order: int
    segment: str
    street: str
    length_m: float
    area_m2: float
    defects: int
    swept: int
    """Number of defects whose centre the window passed over."""
    confirmed: int
    recovered: int
    """Number of defects first confirmed during a revisit."""
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
    """Number of detections of confirmed defects."""
    false_alarms: int
    """Number of detections without a defect."""
    precision: float | None
    """Matched detections over matched detections and false alarms."""
    false_alarms_per_100_m2: float | None
    """Per 100 m² of the surface seen."""
    pci: float
    """Pavement Condition Index (ASTM D6433) of the segment."""
    pci_found: float
    """The index with the confirmed defects alone."""
    pci_error: float
    """`pci_found` − `pci`, in points."""


class SegmentMeter:
    """Meter of a segment: reads the kernel's counters when the segment is closed.

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
            outcomes: number of detections of the mission so far, by outcome.
        """
        segment = self._environment.world.segments[target]
        now = {
            **{"time_s": flight.time_s, "energy": flight.energy_used, "wait_s": flight.waited_s},
            **{"distance_m": flight.distance_m, "occlusions": flight.occlusions, "swaps": swaps},
        }
        before, self._last = self._last, now
        swept = flight.swept()
        defects = self._environment.defects_by_segment.get(segment.id, ())
        surface_coverage = flight.surface_coverage(target)
        swept_count = sum(bool(swept[defect]) for defect in defects)
        return SegmentMetrics(
            order=order,
            segment=segment.id,
            street=segment.street_name,
            length_m=segment.length_m,
            area_m2=segment.area_m2,
            defects=len(defects),
            swept=swept_count,
            surface_coverage=surface_coverage,
            permanently_hidden=permanently_hidden,
            inspected=inspected,
            start_s=before["time_s"],
            end_s=now["time_s"],
            **{name: value - before[name] for name, value in now.items()},
            revisits=revisits,
            **self._detected(segment, swept_count, surface_coverage, memory, outcomes),
        )

    def with_detections(
        self, row: SegmentMetrics, memory: InspectionMemory, outcomes: Counter[Outcome]
    ) -> SegmentMetrics:
        """The row of a closed segment with the detections that were judged after landing.

        Args:
            memory, outcomes: with the detections up to the end of the segment, as in `close`.
        """
        segment = self._environment.world.segment(row.segment)
        return replace(row, **self._detected(segment, row.swept, row.surface_coverage, memory, outcomes))

    def _detected(
        self,
        segment: Segment,
        swept: int,
        surface_coverage: float,
        memory: InspectionMemory,
        outcomes: Counter[Outcome],
    ) -> dict[str, Any]:
        """The metrics that follow from the detections since the segment before."""
        defects = self._environment.defects_by_segment.get(segment.id, ())
        found = [memory.confirmed[defect] for defect in defects if defect in memory.confirmed]
        recovered = sum(confirmation.on_revisit for confirmation in found)
        here, self._judged = outcomes - self._judged, outcomes
        matched = here[Outcome.CONFIRMED] + here[Outcome.DUPLICATE]
        false_alarms = here[Outcome.FALSE_ALARM]
        seen_m2 = surface_coverage * segment.area_m2
        survey = self._environment.survey_of(segment)
        pci, pci_found = survey.pci(), survey.pci(defect for defect in defects if defect in memory.confirmed)
        return {
            "confirmed": len(found),
            "recovered": recovered,
            "coverage": len(found) / len(defects) if defects else None,
            "swath_coverage": len(found) / swept if swept else None,
            "recovery": recovered / swept if swept else None,
            "duplicates": here[Outcome.DUPLICATE],
            "false_alarms": false_alarms,
            "precision": matched / (matched + false_alarms) if matched + false_alarms else None,
            "false_alarms_per_100_m2": 100 * false_alarms / seen_m2 if seen_m2 else None,
            "pci": pci,
            "pci_found": pci_found,
            "pci_error": pci_found - pci,
        }


_SUMMED = (
    *("inspected", "defects", "swept", "confirmed", "recovered"),
    *("wait_s", "occlusions", "revisits", "duplicates", "false_alarms"),
)
"""Totals that are sums over the segments."""


class Measured(Protocol):
    """A mission with its segments' metrics: a result, or a mission in flight."""

    @property
    def rows(self) -> Sequence[SegmentMetrics]: ...
    @property
    def swaps(self) -> int: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def energy(self) -> float: ...
    @property
    def distance_m(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Totals:
    """Totals of a mission. An undefined share is None."""

    segments: int
    inspected: int
    """Number of segments of which enough was seen."""
    defects: int
    swept: int
    confirmed: int
    recovered: int
    coverage: float | None
    swath_coverage: float | None
    recovery: float | None
    surface_coverage: float | None
    """Weighted by area, like `permanently_hidden`."""
    permanently_hidden: float | None
    time_s: float
    """From take-off to landing, including swaps."""
    energy: float
    """In batteries."""
    wait_s: float
    distance_m: float
    occlusions: int
    revisits: int
    swaps: int
    duplicates: int
    false_alarms: int
    precision: float | None
    false_alarms_per_100_m2: float | None
    """Per 100 m² of the surface seen."""

    @property
    def batteries(self) -> int:
        """Number of full batteries to bring."""
        return self.swaps + 1


def totals(mission: Measured) -> Totals:
    """Sums over a mission's segments, and the whole flight's time, energy and distance.

    Args:
        mission: a result, or a mission in flight: then the sums are over the closed segments.
    """
    rows = mission.rows
    sums: dict[str, Any] = {name: sum(getattr(row, name) for row in rows) for name in _SUMMED}
    defects, swept, confirmed, false_alarms = (sums[name] for name in ("defects", "swept", "confirmed", "false_alarms"))
    area_m2, seen_m2 = sum(row.area_m2 for row in rows), sum(row.surface_coverage * row.area_m2 for row in rows)
    hidden_m2 = sum(row.permanently_hidden * row.area_m2 for row in rows)
    matched = confirmed + sums["duplicates"]
    return Totals(
        segments=len(rows),
        **sums,
        coverage=confirmed / defects if defects else None,
        swath_coverage=confirmed / swept if swept else None,
        recovery=sums["recovered"] / swept if swept else None,
        surface_coverage=seen_m2 / area_m2 if area_m2 else None,
        permanently_hidden=hidden_m2 / area_m2 if area_m2 else None,
        time_s=mission.duration_s,
        energy=mission.energy,
        distance_m=mission.distance_m,
        swaps=mission.swaps,
        precision=matched / (matched + false_alarms) if matched + false_alarms else None,
        false_alarms_per_100_m2=100 * false_alarms / seen_m2 if seen_m2 else None,
    )


LEVEL: Final = 0.95
ALIKE: Final = 0.2
"""Correlation of the outcomes of two defects of one street: traffic hides them together."""
WEIGHT: Final = 4.0
"""Degrees of freedom of the prior variance."""
ASSUMED: Final = 10.0
"""Degrees of freedom added to the observed ones in Student's t. With `WEIGHT` alone the intervals are too wide."""

_TAIL: Final = (1 - LEVEL) / 2


@dataclass(frozen=True, slots=True)
class FoundShare:
    """A share of defects found, with its interval."""

    share: float
    low: float
    high: float
    """95 % interval of the share over infinitely many streets like these."""
    defects: int
    """Number of defects behind the share."""


def found_share(found: Sequence[int], defects: Sequence[int]) -> FoundShare | None:
    """The share of defects found over some streets or segments; None without defects.

    Args:
        found, defects: numbers by street or segment.
    """
    m = np.array([count for count in defects if count], dtype=np.float64)
    y = np.array([each for each, count in zip(found, defects, strict=True) if count], dtype=np.float64)
    total = float(m.sum())
    if not total:
        return None
    share, freedom = float(y.sum()) / total, len(m) - 1
    # Linearised variance of a ratio: streets with more defects weigh more.
    variance = len(m) / freedom * float(((y - share * m) ** 2).sum()) / total**2 if freedom else 0.0
    usual = float((m * (1 + (m - 1) * ALIKE)).sum()) / total**2
    return FoundShare(share, *limits(share, variance, usual, freedom, round(total)), round(total))


def usual_of_street(defects: Float64Array) -> Float64Array:
    """Prior variance of the share of each street, as a multiple of p (1 − p).

    Args:
        defects: (streets,) numbers above 0.
    """
    return 1 / defects + (1 - 1 / defects) * ALIKE


def limits(share: float, variance: float, usual: float, freedom: int, defects: int) -> tuple[float, float]:
    """The 95 % interval of a share.

    Args:
        variance: variance of the estimate, observed between streets.
        usual: prior variance, as a multiple of p (1 − p).
        freedom: degrees of freedom of the observed variance.
        defects: number of defects behind the share.
    """
    from scipy.special import betaincinv, stdtrit  # takes 0.2 s to import, and nothing else needs it

    spread = share * (1 - share)
    pooled = (freedom * variance + WEIGHT * spread * usual) / (freedom + WEIGHT)
    effective = spread / max(variance, pooled) if spread > 0 else 1 / usual
    t, normal = stdtrit(freedom + ASSUMED, 1 - _TAIL), stdtrit(max(defects - 1, 1), 1 - _TAIL)
    effective = min(effective, defects) * min(float(normal / t) ** 2, 1.0)
    hits, misses = share * effective, (1 - share) * effective
    low = float(betaincinv(hits, misses + 1, _TAIL)) if hits > 0 else 0.0
    high = float(betaincinv(hits + 1, misses, 1 - _TAIL)) if misses > 0 else 1.0
    return low, high
