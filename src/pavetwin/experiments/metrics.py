"""What a study measures of every mission, and the other columns of its table.

The table has one row a segment mission, the part of a mission over one of its segments: its factors, `replicate`, what
it was seeded with, `status`, the metrics. A metric that is undefined (no defects on the segment), and every metric of
a mission that failed, is null.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from pavetwin.sensing.base import PARAMETER_DRAWS

if TYPE_CHECKING:
    import polars as pl

FACTORS: Final = ("world", "traffic", "altitude_m", "policy", "sensor", "preset")
"""Columns of what a design varies; those of its sweep come after them. Missions of one cell share all of these."""

REPLICATE: Final = "replicate"
"""Missions with the same replicate and world share traffic, defects and segment: they are compared in pairs."""

FILES: Final = "files_hash"
"""Of the user's own files that a mission was flown with, null for none; in studies that name such files."""

RENDERER: Final = "renderer"
"""What drew the images that a mission's sensor looked at; in parts of the table where one did."""

COVERAGE_DRAWS: Final = tuple(f"coverage_draw_{number:02d}" for number in range(1, PARAMETER_DRAWS + 1))
"""Expected coverage in each draw of a fitted sensor's parameters; in studies that have such a sensor."""

STATUS, FLOWN, FAILED, REASON = "status", "flown", "failed", "reason"

REFERENCE: Final = "baseline"
"""The policy that the others are compared with unless the design says otherwise."""

EVERY_PAIR: Final = "all"
"""What a design says to compare every pair of policies."""


@dataclass(frozen=True)
class Metric:
    """One column of the table that is measured."""

    name: str
    label: str
    unit: str
    """Of the values as they are shown."""
    scale: float
    """Shown values are the table's times this."""
    digits: int
    more_is_better: bool | None
    """None where neither is."""
    signed: bool = False
    """Whether it may be below 0."""
    of: str = ""
    """The column with the number of defects that it is a share of; empty for any other metric."""


METRICS: Final = (
    Metric("coverage", "Coverage", "%", 100.0, 1, more_is_better=True, of="defects"),
    Metric("swath_coverage", "Swath coverage", "%", 100.0, 1, more_is_better=True, of="swept"),
    Metric("recovery", "Recovery", "%", 100.0, 1, more_is_better=True, of="swept"),
    Metric("surface_coverage", "Surface coverage", "%", 100.0, 1, more_is_better=True),
    Metric("time_s", "Time", "s", 1.0, 1, more_is_better=False),
    Metric("energy", "Energy", "% of a battery", 100.0, 2, more_is_better=False),
    Metric("wait_s", "Waiting", "s", 1.0, 1, more_is_better=False),
    Metric("distance_m", "Distance", "m", 1.0, 0, more_is_better=None),
    Metric("occlusions", "Occlusions", "", 1.0, 1, more_is_better=None),
)
"""The first is what a study is about; `time_s` and `energy` have heavy tails, since waiting has."""

PARKING_METRICS: Final = (Metric("permanently_hidden", "Permanently hidden", "%", 100.0, 1, more_is_better=None),)
"""Where vehicles are parked: they take this from the surface coverage that can be reached."""

ERROR_METRICS: Final = (
    Metric("precision", "Precision", "%", 100.0, 1, more_is_better=True),
    Metric("false_alarms", "False alarms", "", 1.0, 1, more_is_better=False),
    Metric("false_alarms_per_100_m2", "False alarms per 100 m²", "", 1.0, 2, more_is_better=False),
    Metric("duplicates", "Duplicates", "", 1.0, 1, more_is_better=None),
)
"""Of sensors that report what is not there, or one defect twice. Shown where one did: see `metrics_in`."""

BATTERIES: Final = "batteries"

TOUR_METRICS: Final = (Metric(BATTERIES, "Batteries", "", 1.0, 1, more_is_better=False),)
"""Of missions that are tours (`experiments.tours`): full batteries that one took."""

CONDITION_METRICS: Final = (Metric("pci_error", "PCI error", "points", 1.0, 1, more_is_better=False),)
"""What is missed makes a road look sounder than it is. Studies of earlier versions do not have it."""

INDEX_ERROR: Final = "pci_detected_abs_error"

DETECTED_METRICS: Final = (
    Metric("pci_detected_error", "Index as detected less true", "points", 1.0, 1, more_is_better=None, signed=True),
    Metric(INDEX_ERROR, "Index error as detected", "points", 1.0, 1, more_is_better=False),
)
"""Of sensors that measure sizes: how far the index by what they detected is off, with its sign and without."""

DETECTED: Final = ("pci_detected", *(metric.name for metric in DETECTED_METRICS))
"""Columns of studies that have such a sensor; null where another one was flown."""

COMPARED: Final = ("coverage", "time_s", "energy")
"""What options are compared by: all tests of these together are one family."""


EVERY_METRIC: Final = (*METRICS, *TOUR_METRICS, *PARKING_METRICS, *ERROR_METRICS, *CONDITION_METRICS, *DETECTED_METRICS)


def metric_named(name: str) -> Metric:
    """The metric of a column; KeyError when it is none."""
    return {metric.name: metric for metric in EVERY_METRIC}[name]


def metrics_in(table: "pl.DataFrame") -> tuple[Metric, ...]:
    """What there is to show of a table: `METRICS`, the error of the condition index where it was measured, those of
    tours where missions are such, what parked vehicles hide where there are some, those of a sensor's errors where
    a mission has such errors, and those of what it measured where it did."""
    condition = [metric for metric in CONDITION_METRICS if metric.name in table.columns]
    tours = [metric for metric in TOUR_METRICS if metric.name in table.columns]
    names = ("permanently_hidden", "false_alarms", "duplicates")
    has = {name: name in table.columns and bool(table[name].sum()) for name in names}
    rest = (each for each in (*PARKING_METRICS, *ERROR_METRICS) if has.get(each.name, has["false_alarms"]))
    measured = DETECTED_METRICS if has_detected(table) else ()
    return (*METRICS, *condition, *tours, *rest, *measured)


def has_detected(table: "pl.DataFrame") -> bool:
    """Whether a sensor measured what it detected in a mission of the table; studies of earlier versions have none."""
    return INDEX_ERROR in table.columns and table[INDEX_ERROR].null_count() < table.height
