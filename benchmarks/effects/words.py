"""Differences in words, and Markdown tables of them."""

from collections.abc import Sequence
from typing import Any

import polars as pl

from pavetwin.experiments.metrics import Metric
from pavetwin.reports.words import MISSING, number


def gap(frame: pl.DataFrame, metric: Metric, *, relative: bool = False) -> str:
    """`**−2.3** (−3.0 to −1.6)` of a row of `Effect.flight`, bold where the interval excludes 0.

    Args:
        relative: as a share, in %, of what it is without the change.
    """
    row: dict[str, Any] = frame.row(by_predicate=pl.col("metric") == metric.name, named=True)
    scale, digits = metric.scale, metric.digits
    if relative:
        scale, digits = 100 / row["before"] if row["before"] else 0.0, 0
    if row["mean"] is None:
        return MISSING
    if row["mean"] == 0 and row["low"] == row["high"]:
        return "0"
    text = signed(row["mean"] * scale, digits)
    if row["low"] is None or row["high"] is None:
        return text
    if row["low"] > 0 or row["high"] < 0:
        text = f"**{text}**"
    return f"{text} ({signed(row['low'] * scale, digits)} to {signed(row['high'] * scale, digits)})"


def signed(value: float, digits: int) -> str:
    text = number(value, digits)
    return text if text.startswith("−") or float(text) == 0 else f"+{text}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows])
