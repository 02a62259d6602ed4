"""How reports, tables and sentences name factors, levels, amounts and probabilities."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, Final

from pavetwin.experiments.metrics import FACTORS, METRICS, Metric

MISSING: Final = "—"
"""Where there is no value: never a 0, never a 100."""

SMALLEST_P: Final = 0.001

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
"""What a factor is called, what its levels are called together, and how a sentence names one, in this order."""


def factor_text(name: str) -> str:
    """What a factor is called; a swept parameter is called as in the design."""
    return _FACTORS[name][0] if name in _FACTORS else _as_designed(name)


def _as_designed(column: str) -> str:
    """A swept setting: its column ends in `_set` where it would else be that of a metric."""
    setting = column.removesuffix("_set")
    return setting if setting in {metric.name for metric in METRICS} else column


def factor_name(column: str) -> str:
    """The same within a sentence."""
    return factor_text(column).lower() if column in _FACTORS else _as_designed(column)


def factors_text(name: str) -> str:
    """What its levels are called together."""
    return _FACTORS[name][1] if name in _FACTORS else f"values of {_as_designed(name)}"


def term_text(term: str) -> str:
    """`Traffic × Policy` for `traffic × policy`."""
    return " × ".join(factor_text(part) for part in term.split(" × "))


def level_name(level: object) -> str:
    if isinstance(level, bool):
        return "yes" if level else "no"
    return f"{level:g}" if isinstance(level, float) else str(level)


def level_text(factor: str, level: Any) -> str:
    """`6 m`, `hover`, `0.5`, `yes`; a dash for what a mission lacks."""
    if level is None:
        return "all" if factor in FACTORS else MISSING
    return level_name(level) + ("\u00a0m" if factor == "altitude_m" else "")


def setting(cell: Mapping[str, Any], columns: Sequence[str]) -> str:
    """`in high traffic at 6 m with tau_o = 0.7`, without what the missions lack; `over all missions` of nothing."""
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


def subject(factor: str, level: object) -> str:
    """A level as what is compared: `hover`, `10 m`, `tau_o = 0.5`."""
    if factor == "altitude_m":
        return f"{level_name(level)} m"
    return level_name(level) if factor in _FACTORS else f"{_as_designed(factor)} = {level_name(level)}"


def among(factor: str, level: object) -> str:
    """What was flown with a level: `with hover`, `at 10 m`, `with tau_o = 0.5`."""
    return f"{'at' if factor == 'altitude_m' else 'with'} {subject(factor, level)}"


def number(value: float | None, digits: int) -> str:
    """A number with its decimals and a true minus sign; a dash where there is none."""
    if value is None or not isfinite(value):
        return MISSING
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def nonzero(value: float, digits: int) -> str:
    """With more digits where it would be 0 otherwise: an interval must not seem to touch 0."""
    while value and digits < 9 and round(value, digits) == 0:
        digits += 1
    return number(value, digits)


def shown(metric: Metric, value: float | None) -> str:
    """A value of the table in the metric's unit and digits."""
    return number(None if value is None else value * metric.scale, metric.digits)


def amount(metric: Metric, value: float) -> str:
    """A value of the table with its unit, never 0 by rounding."""
    return nonzero(value * metric.scale, metric.digits) + (f" {metric.unit}" if metric.unit else "")


def difference(metric: Metric, gap: float) -> str:
    """A difference with its unit: that of two shares is in percentage points."""
    size = nonzero(gap * metric.scale, metric.digits)
    return f"{size} percentage points" if metric.unit == "%" else amount(metric, gap)


def span(metric: Metric, low: float, high: float) -> str:
    """`1.9 to 6.4`, in the shown unit but without it."""
    return f"{nonzero(low * metric.scale, metric.digits)} to {nonzero(high * metric.scale, metric.digits)}"


def heading(metric: Metric) -> str:
    """`Time (s)`."""
    return f"{metric.label} ({metric.unit})" if metric.unit else metric.label


def percent(share: float) -> str:
    """Never 0 or 100 by rounding."""
    if 0.995 <= share < 1:
        return "over 99 %"
    return "under 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def probability(p: float) -> str:
    return f"p < {SMALLEST_P:g}" if p < SMALLEST_P else f"p = {p:.2g}"


def p_text(p: float | None) -> str:
    if p is None:
        return MISSING
    return f"<\u2009{SMALLEST_P:g}" if p < SMALLEST_P else f"{p:.3f}"


def listed(parts: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def counted(count: int, one: str, many: str | None = None) -> str:
    """`1 mission`, `720 missions`."""
    return f"{count:,} {one if count == 1 else many or one + 's'}".replace(",", "\u2009")


def opened(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:] + "."
