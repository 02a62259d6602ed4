"""The wording of numbers, counts and lists in reports and messages."""

from collections.abc import Sequence
from math import isfinite
from typing import Final

MISSING: Final = "—"
"""Shown in place of a missing value: never 0, never 100."""

SMALLEST_P: Final = 0.001
"""Smaller p are shown as smaller than this."""


def number(value: float | None, digits: int) -> str:
    """A number with its decimals and a true minus sign; `MISSING` for None and NaN."""
    if value is None or not isfinite(value):
        return MISSING
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def nonzero(value: float, digits: int) -> str:
    """A number with as many more digits as it takes not to read 0: an interval must not seem to touch 0."""
    while value and digits < 9 and round(value, digits) == 0:
        digits += 1
    return number(value, digits)


def percent(share: float) -> str:
    """A share in whole per cent, never rounded to 0 or 100."""
    if 0.995 <= share < 1:
        return "over 99 %"
    return "under 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def probability(p: float) -> str:
    """A p-value in a sentence: `p = 0.012`, `p < 0.001`."""
    return f"p < {SMALLEST_P:g}" if p < SMALLEST_P else f"p = {p:.2g}"


def p_text(p: float | None) -> str:
    """A p-value in a table: `0.012`, `< 0.001`."""
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
    """A sentence with its first letter in upper case and its full stop."""
    return sentence[:1].upper() + sentence[1:] + "."
