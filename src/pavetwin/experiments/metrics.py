"""The columns of a study's table: factors, status and metrics.

The table has one row per segment mission, the part of a mission over one of its segments: its factors, `replicate`, its
seeds, `status` and the metrics. Undefined metrics (such as coverage of a segment without defects) and all metrics of
failed missions are null.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from pavetwin.sensing.sensor import PARAMETER_DRAWS

if TYPE_CHECKING:
    import polars as pl

FACTORS: Final = ("world", "traffic", "altitude_m", "policy", "sensor", "preset")
"""Columns of the factors; swept settings follow. Missions of one cell share all of these."""

REPLICATE: Final = "replicate"
"""Missions of one replicate and world share traffic, defects and segment, and are compared in pairs."""

FILES: Final = "files_hash"
"""Hash of the user's own files that a mission depends on, null for none; in studies that name such files."""

RENDERER: Final = "renderer"
"""Renderer of the images that a mission's sensor analysed; in parts of the table with such sensors."""

COVERAGE_DRAWS: Final = tuple(f"coverage_draw_{number:02d}" for number in range(1, PARAMETER_DRAWS + 1))
"""Expected coverage in each draw of a fitted sensor's parameters; in studies with such a sensor."""

STATUS, FLOWN, FAILED, REASON = "status", "flown", "failed", "reason"

REFERENCE: Final = "baseline"
"""The reference policy unless the design names another."""

EVERY_PAIR: Final = "all"
"""Value of `compare` in a design that compares every pair of policies."""


@dataclass(frozen=True)
class Metric:
    """One measured column of the table."""

    name: str
    label: str
    unit: str
    """Unit of the shown values."""
    scale: float
    """Factor from the table's values to shown values."""
    digits: int
    more_is_better: bool | None
    """None if neither is better."""
    signed: bool = False
    """True if it may be negative."""
    of: str = ""
    """The column with the number of defects that it is a share of; empty for other metrics."""


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
    Metric("pci_error", "PCI error", "points", 1.0, 1, more_is_better=False),
)
"""Metrics of every study, the main one first. `time_s` and `energy` have heavy tails, since waiting has. Missed defects
make a road look better than it is (`pci_error`)."""

PARKING_METRICS: Final = (Metric("permanently_hidden", "Permanently hidden", "%", 100.0, 1, more_is_better=None),)
"""With parked vehicles: the share of the surface that no policy can see."""

ERROR_METRICS: Final = (
    Metric("precision", "Precision", "%", 100.0, 1, more_is_better=True),
    Metric("false_alarms", "False alarms", "", 1.0, 1, more_is_better=False),
    Metric("false_alarms_per_100_m2", "False alarms per 100 m²", "", 1.0, 2, more_is_better=False),
    Metric("duplicates", "Duplicates", "", 1.0, 1, more_is_better=None),
)
"""Metrics of sensors with false alarms or repeated detections; shown if there are any, see `metrics_in`."""

BATTERIES: Final = "batteries"

TOUR_METRICS: Final = (Metric(BATTERIES, "Batteries", "", 1.0, 1, more_is_better=False),)
"""Full batteries that a mission of tours (`experiments.tours`) takes."""

INDEX_ERROR: Final = "pci_detected_abs_error"

DETECTED_METRICS: Final = (
    Metric("pci_detected_error", "Index as detected less true", "points", 1.0, 1, more_is_better=None, signed=True),
    Metric(INDEX_ERROR, "Index error as detected", "points", 1.0, 1, more_is_better=False),
)
"""Error of the condition index by the detections of sensors that measure sizes, with its sign and without."""

DETECTED: Final = ("pci_detected", *(metric.name for metric in DETECTED_METRICS))
"""Columns of studies with such a sensor; null in missions with another."""

COMPARED: Final = ("coverage", "time_s", "energy")
"""Metrics that options are compared by; their tests are one family."""


EVERY_METRIC: Final = (*METRICS, *TOUR_METRICS, *PARKING_METRICS, *ERROR_METRICS, *DETECTED_METRICS)


def metric_named(name: str) -> Metric:
    """The metric of a column. KeyError if it is not one."""
    return {metric.name: metric for metric in EVERY_METRIC}[name]


def metrics_in(table: "pl.DataFrame") -> tuple[Metric, ...]:
    """The metrics to show of a table: `METRICS`, and those of tours, of parked vehicles, of a sensor's errors and of
    its measurements if the table has any."""
    tours = [metric for metric in TOUR_METRICS if metric.name in table.columns]
    names = ("permanently_hidden", "false_alarms", "duplicates")
    has = {name: name in table.columns and bool(table[name].sum()) for name in names}
    rest = (each for each in (*PARKING_METRICS, *ERROR_METRICS) if has.get(each.name, has["false_alarms"]))
    measured = DETECTED_METRICS if has_detected(table) else ()
    return (*METRICS, *tours, *rest, *measured)


def has_detected(table: "pl.DataFrame") -> bool:
    """True if a sensor measured its detections in some mission of the table."""
    return INDEX_ERROR in table.columns and table[INDEX_ERROR].null_count() < table.height
