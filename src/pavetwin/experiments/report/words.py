"""Values in words: numbers with their digits, factors and levels with their names and units."""

from math import isfinite
from typing import Any, Final

from pavetwin.experiments.metrics import FACTORS, Metric

MISSING: Final = "—"
"""Where there is no value: never a 0, never a 100."""

SMALLEST_P: Final = 0.001

_FACTORS = {
    "world": "World",
    "traffic": "Traffic",
    "altitude_m": "Altitude",
    "policy": "Policy",
    "sensor": "Sensor",
    "preset": "Preset",
    "replicate": "Replicate",
    "residual": "Residual",
}
_PLURALS = {
    "world": "worlds",
    "traffic": "traffic densities",
    "altitude_m": "altitudes",
    "policy": "policies",
    "sensor": "sensors",
    "preset": "presets",
}


def number(value: float | None, digits: int) -> str:
    """A number with its decimals and a true minus sign; a dash where there is none."""
    if value is None or not isfinite(value):
        return MISSING
    rounded = round(value, digits) + 0.0
    return f"{rounded:.{digits}f}".replace("-", "−")


def shown(metric: Metric, value: float | None) -> str:
    """A value of the table in the metric's unit and digits."""
    return number(None if value is None else value * metric.scale, metric.digits)


def heading(metric: Metric) -> str:
    """`Time (s)`."""
    return f"{metric.label} ({metric.unit})" if metric.unit else metric.label


def p_text(p: float | None) -> str:
    if p is None:
        return MISSING
    return f"<\u2009{SMALLEST_P:g}" if p < SMALLEST_P else f"{p:.3f}"


def factor_text(name: str) -> str:
    """What a factor is called; a swept parameter is called as in the design."""
    return _FACTORS.get(name, name)


def factors_text(name: str) -> str:
    """What its levels are called together."""
    return _PLURALS.get(name, f"values of {name}")


def term_text(term: str) -> str:
    """`Traffic × Policy` for `traffic × policy`."""
    return " × ".join(factor_text(part) for part in term.split(" × "))


def level_text(factor: str, level: Any) -> str:
    """`6 m`, `hover`, `0.5`, `yes`."""
    if level is None:
        return "all" if factor in FACTORS else "none"
    if isinstance(level, bool):
        return "yes" if level else "no"
    text = f"{level:g}" if isinstance(level, int | float) else str(level)
    return f"{text}\u00a0m" if factor == "altitude_m" else text


def counted(count: int, one: str, many: str | None = None) -> str:
    """`1 mission`, `720 missions`."""
    return f"{count:,} {one if count == 1 else many or one + 's'}".replace(",", "\u2009")
