"""The answers of a study by sensor: what is found, what is recommended, what it costs, how the condition index errs."""

from typing import Final

import numpy as np
import polars as pl

from pavetwin.experiments.advice import advise
from pavetwin.experiments.metrics import REPLICATE
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.experiments.statistics.bootstrap import intervals

SHOWN: Final = ("coverage", "pci_error")


def by_sensor(table: pl.DataFrame, by: tuple[str, ...] = ("sensor", "altitude_m")) -> pl.DataFrame:
    """Means with 95 % intervals over replicates, of coverage, the error of the condition index and time a kilometre."""
    flown = table.filter(status="flown").with_columns(s_per_km=1000 * pl.col("time_s") / pl.col("length_m"))
    rows = []
    for key, part in flown.group_by(*by, maintain_order=True):
        row = dict(zip(by, key, strict=True))
        for name in (*SHOWN, "s_per_km", "false_alarms_per_100_m2"):
            means = part.group_by(REPLICATE).agg(pl.col(name).mean())[name].drop_nulls().to_numpy()
            if len(means):
                row[name] = float(means.mean())
            if len(means) > 1:
                low, high = intervals(means[np.newaxis], np.zeros(len(means), dtype=np.intp), 0)
                row |= {f"{name}_low": float(low[0]), f"{name}_high": float(high[0])}
        rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def answers(table: pl.DataFrame) -> str:
    """In Markdown: means by sensor and altitude, and what is recommended in each density."""
    lines = [
        "| sensor | altitude | found, % | PCI too high by | false alarms per 100 m² | s per km |",
        "|---" * 6 + "|",
    ]
    for row in by_sensor(table).iter_rows(named=True):
        alarms = row.get("false_alarms_per_100_m2")
        cells = [
            row["sensor"],
            f"{row['altitude_m']:g} m",
            _span(row, "coverage", 100.0, 0),
            _span(row, "pci_error", 1.0, 1),
            "–" if alarms is None else f"{alarms:.1f}",
            f"{row['s_per_km']:.0f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| sensor | traffic | recommended | found, % | best with | s per km |", "|---" * 6 + "|"]
    for sensor in table["sensor"].unique(maintain_order=True):
        for traffic in table["traffic"].unique(maintain_order=True):
            lines.append(_recommended(table.filter(sensor=sensor, traffic=traffic), sensor, traffic))
    return "\n".join(lines)


def _recommended(part: pl.DataFrame, sensor: str, traffic: str) -> str:
    (advice,) = advise(part, MissionLimits())
    made = advice.recommendation
    assert made.best is not None
    mine = part.filter(pl.col(name) == made.best[name] for name in made.by)
    km = 1000 * float(mine["time_s"].sum()) / float(mine["length_m"].sum())
    sure = made.options.row(0, named=True).get("certainty")
    words = f"{made.best['policy']} at {made.best['altitude_m']:g} m"
    found = 100 * float(mine["coverage"].mean())  # type: ignore[arg-type]
    sureness = "–" if sure is None else f"{100 * sure:.0f} %"
    return f"| {sensor} | {traffic} | {words} | {found:.0f} | {sureness} | {km:.0f} |"


def _span(row: dict[str, float], name: str, scale: float, digits: int) -> str:
    """A mean with its interval, which a single replicate has not."""
    if row.get(f"{name}_low") is None:
        return f"{scale * row[name]:.{digits}f}"
    low, high = scale * row[f"{name}_low"], scale * row[f"{name}_high"]
    return f"{scale * row[name]:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"
