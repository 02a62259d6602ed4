"""Wording of factors, levels, options and metrics in reports, tables and sentences."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pavetwin.experiments.metrics import FACTORS, METRICS, Metric
from pavetwin.reports.words import MISSING, nonzero, number

_FACTORS: Final = {
    "traffic": ("Traffic", "traffic densities", "in {} traffic"),
    "altitude_m": ("Altitude", "altitudes", "at {} m"),
    "world": ("World", "worlds", "in the world {}"),
    "policy": ("Policy", "policies", "with {}"),
    "sensor": ("Sensor", "sensors", "with the sensor {}"),
    "preset": ("Preset", "presets", "with the preset {}"),
    "replicate": ("Replicate", "replicates", "in replicate {}"),
    "residual": ("Residual", "", ""),
}
"""Name of a factor, plural of its levels, and a level in a sentence, in the order of a sentence."""


def factor_text(name: str) -> str:
    """Name of a factor; a swept parameter keeps the name of the design."""
    return _FACTORS[name][0] if name in _FACTORS else _as_designed(name)


def _as_designed(column: str) -> str:
    """Name of a swept setting. Its column ends in `_set` if a metric has the same name."""
    setting = column.removesuffix("_set")
    return setting if setting in {metric.name for metric in METRICS} else column


def factors_text(name: str) -> str:
    """Plural of a factor's levels."""
    return _FACTORS[name][1] if name in _FACTORS else f"values of {_as_designed(name)}"


def term_text(term: str) -> str:
    """`Traffic × Policy` for `traffic × policy`."""
    return " × ".join(factor_text(part) for part in term.split(" × "))


def level_name(level: object) -> str:
    """`yes`, `0.5`, `hover`."""
    if isinstance(level, bool):
        return "yes" if level else "no"
    return f"{level:g}" if isinstance(level, float) else str(level)


def level_text(factor: str, level: Any) -> str:
    """`6 m`, `hover`, `0.5`, `yes`; a dash if the mission does not have the factor."""
    if level is None:
        return "all" if factor in FACTORS else MISSING
    return level_name(level) + ("\u00a0m" if factor == "altitude_m" else "")


def setting(cell: Mapping[str, Any], columns: Sequence[str]) -> str:
    """`in high traffic at 6 m with tau_o = 0.7`, without factors that the missions do not have."""
    known = [column for column in _FACTORS if column in columns]
    others = [column for column in columns if column not in known and cell[column] is not None]
    return (
        " ".join(
            [
                *(_FACTORS[column][2].format(level_name(cell[column])) for column in known),
                *(f"with {_as_designed(column)} = {level_name(cell[column])}" for column in others),
            ]
        )
        or "over all missions"
    )


def option_text(option: Mapping[str, Any], by: Sequence[str]) -> str:
    """`hover at 10 m`: an option by its levels, the policy first."""
    rest = [column for column in by if column != "policy"]
    return " ".join([str(option["policy"])] * ("policy" in by) + [setting(option, rest)] * bool(rest))


def subject(factor: str, level: object) -> str:
    """A level as the subject of a comparison: `hover`, `10 m`, `tau_o = 0.5`."""
    if factor == "altitude_m":
        return f"{level_name(level)} m"
    return level_name(level) if factor in _FACTORS else f"{_as_designed(factor)} = {level_name(level)}"


def shown(metric: Metric, value: float | None) -> str:
    """A value of the table in the metric's unit and digits."""
    return number(None if value is None else value * metric.scale, metric.digits)


def amount(metric: Metric, value: float) -> str:
    """A value of the table with its unit, never rounded to 0."""
    return nonzero(value * metric.scale, metric.digits) + (f" {metric.unit}" if metric.unit else "")


def difference(metric: Metric, gap: float) -> str:
    """A difference with its unit; shares differ by percentage points."""
    size = nonzero(gap * metric.scale, metric.digits)
    return f"{size} percentage points" if metric.unit == "%" else amount(metric, gap)


def span(metric: Metric, low: float, high: float) -> str:
    """`1.9 to 6.4`, in the shown unit but without it."""
    return f"{nonzero(low * metric.scale, metric.digits)} to {nonzero(high * metric.scale, metric.digits)}"


def heading(metric: Metric) -> str:
    """`Time (s)`."""
    return f"{metric.label} ({metric.unit})" if metric.unit else metric.label
