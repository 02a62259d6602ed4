"""How sentences name cells, amounts and probabilities."""

from collections.abc import Mapping, Sequence
from typing import Any

from pavetwin.experiments.metrics import Metric

_NAMES = {"altitude_m": "altitude"}
_PLACES = {
    "traffic": "in {} traffic",
    "altitude_m": "at {} m",
    "world": "in the world {}",
    "policy": "with {}",
    "sensor": "with the sensor {}",
    "preset": "with the preset {}",
}
_ORDER = tuple(_PLACES)


def factor_name(column: str) -> str:
    return _NAMES.get(column, column)


def setting(cell: Mapping[str, Any], columns: Sequence[str]) -> str:
    """`in high traffic at 6 m with tau_o = 0.7`; `over all missions` of no columns."""
    ordered = sorted(columns, key=lambda column: _ORDER.index(column) if column in _ORDER else len(_ORDER))
    return (
        " ".join(_PLACES.get(column, f"with {column} = {{}}").format(level_name(cell[column])) for column in ordered)
        or "over all missions"
    )


def level_name(level: object) -> str:
    if isinstance(level, bool):
        return "true" if level else "false"
    return f"{level:g}" if isinstance(level, float) else str(level)


def subject(factor: str, level: object) -> str:
    """A level as what does something: `hover`, `an altitude of 10 m`, `tau_o = 0.5`."""
    if factor == "altitude_m":
        return f"an altitude of {level_name(level)} m"
    return level_name(level) if factor in _PLACES else f"{factor} = {level_name(level)}"


def number(value: float, digits: int) -> str:
    """With a true minus, and with more digits where it would be 0 otherwise: an interval must not seem to touch 0."""
    while value and digits < 9 and round(value, digits) == 0:
        digits += 1
    text = f"{round(value, digits) + 0.0:.{digits}f}"
    return text.replace("-", "−")


def amount(metric: Metric, value: float) -> str:
    """A value of the table with its unit, as shown."""
    unit = f" {metric.unit}" if metric.unit else ""
    return number(value * metric.scale, metric.digits) + unit


def span(metric: Metric, low: float, high: float) -> str:
    """`1.9 to 6.4`, in the shown unit but without it."""
    return f"{number(low * metric.scale, metric.digits)} to {number(high * metric.scale, metric.digits)}"


def percent(share: float) -> str:
    """Never 0 or 100 by rounding."""
    if 0.995 <= share < 1:
        return "over 99 %"
    return "under 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def probability(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def difference(metric: Metric, gap: float) -> str:
    """A difference with its unit: that of two shares is in percentage points."""
    return (
        f"{number(gap * metric.scale, metric.digits)} percentage points" if metric.unit == "%" else amount(metric, gap)
    )


def listed(parts: Sequence[str], last: str = "and") -> str:
    """`a`, `a and b`, `a, b and c`."""
    return f" {last} ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def opened(sentence: str) -> str:
    """With a capital letter and a full stop."""
    return sentence[:1].upper() + sentence[1:] + "."
