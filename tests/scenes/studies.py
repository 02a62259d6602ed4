"""Made-up tables of studies with a known truth, streets with few defects, and a design of few missions."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from pavetwin.experiments.design import Design
from pavetwin.experiments.metrics import METRICS

PAPER: Mapping[str, Sequence[Any]] = {
    "world": ("town",),
    "traffic": ("low", "medium", "high"),
    "altitude_m": (6.0, 10.0, 15.0),
    "policy": ("baseline", "hover", "micro", "skip"),
    "sensor": ("recall",),
    "preset": ("paper",),
}
SMALL = {**PAPER, "traffic": ("low", "high"), "altitude_m": (6.0,), "policy": ("baseline", "hover", "micro")}

DRAWN = METRICS[:-1]
"""The metrics with random values; the last, `pci_error`, is constant."""

Truth = Callable[[dict[str, Any]], dict[str, float]]
"""Effect of a cell on each metric."""


def no_effect(_cell: dict[str, Any]) -> dict[str, float]:
    return {}


def study(
    levels: Mapping[str, Sequence[Any]] = SMALL, replicates: int = 20, truth: Truth = no_effect, seed: int = 0
) -> pl.DataFrame:
    """One row a mission. Values vary by replicate, by its traffic, and by mission; energy goes by time."""
    rng = np.random.default_rng(seed)
    rows = [dict(zip(levels, cell, strict=True)) for cell in product(*levels.values())]
    draws: dict[tuple[Any, ...], np.ndarray] = {}

    def drawn(*key: Any) -> np.ndarray:
        return draws.setdefault(key, rng.normal(size=len(DRAWN)))

    table = []
    for cell, replicate in product(rows, range(replicates)):
        shared = drawn(cell["world"], replicate), drawn(cell["world"], replicate, cell["traffic"])
        noise = (shared[0] + 0.5 * shared[1] + 0.5 * rng.normal(size=len(DRAWN))).tolist()
        added = truth(cell)
        values = {
            metric.name: (0.7 + 0.04 * part if metric.unit == "%" else 60.0 + 8.0 * part) + added.get(metric.name, 0.0)
            for metric, part in zip(DRAWN, noise, strict=True)
        }
        values["pci_error"] = 5.0
        values["energy"] = values["time_s"] / 1800.0
        table.append({**cell, "replicate": replicate, "status": "flown", "reason": None, **values})
    return pl.DataFrame(table, schema_overrides={"reason": pl.String}, infer_schema_length=None)


def without(table: pl.DataFrame, gone: pl.Expr, *, failed: bool) -> pl.DataFrame:
    """The same table where the missions `gone` failed, or flew over no defects (their coverage is null)."""
    if not failed:
        return table.with_columns(coverage=pl.when(gone).then(None).otherwise(pl.col("coverage")))
    metrics = [pl.when(gone).then(None).otherwise(pl.col(metric.name)).alias(metric.name) for metric in METRICS]
    status = pl.when(gone).then(pl.lit("failed")).otherwise(pl.col("status")).alias("status")
    return table.with_columns(status, *metrics)


CASES = [(truth, alike) for truth in (0.6, 0.84, 0.95) for alike in (0.02, 0.1, 0.2)]
"""The chance that a defect is found, and the correlation between those of one street."""


def streets(rng: np.random.Generator, count: int, defects: int, truth: float, alike: float) -> tuple[np.ndarray, ...]:
    """(streets,) found and there: the chance varies from street to street so that defects of one are correlated."""
    there = rng.poisson(defects * rng.lognormal(-0.18, 0.6, count))
    a, b = truth * (1 - alike) / alike, (1 - truth) * (1 - alike) / alike
    return rng.binomial(there, rng.beta(a, b, count)), there


def small(world: Path, **values: object) -> Design:
    usual = {
        "worlds": [str(world)],
        "densities": ["low", "medium"],
        "altitudes_m": [6, 10],
        "policies": ["baseline", "hover"],
        "presets": ["paper"],
        "replicates": 3,
        "seed": 4,
    }
    return Design.parse(usual | values, where="the design")
