"""What a study advises: a recommendation for each combination of its assumptions."""

from dataclasses import dataclass

import polars as pl

from pavetwin.experiments.design import ALIASES, ENVIRONMENT
from pavetwin.experiments.metrics import REPLICATE
from pavetwin.experiments.statistics import MissionLimits, Recommendation, recommend
from pavetwin.experiments.words import opened, setting

ASSUMED = ("sensor", "preset")
"""Factors that are assumptions of a study, not options to choose from."""


@dataclass(frozen=True)
class Advice:
    assumption: str
    """The sensor and the preset as a sentence; empty where the study has one of each."""
    recommendation: Recommendation


def advise(table: pl.DataFrame, limits: MissionLimits, *, seed: int = 0) -> list[Advice]:
    """A recommendation among altitudes, policies and swept settings, over the worlds and traffic of the table."""
    varied = table.columns[table.columns.index("altitude_m") : table.columns.index(REPLICATE)]
    given = {name for name in varied if ALIASES.get(name, name) in ENVIRONMENT}
    chosen_by = {name for name in varied if name not in {*ASSUMED, *given} and table[name].n_unique() > 1}
    by = [name for name in varied if name in chosen_by | {"altitude_m", "policy"}]
    assumed = [name for name in ASSUMED if table[name].n_unique() > 1]
    parts = table.partition_by(assumed, maintain_order=True) if assumed else [table]
    return [
        Advice(
            opened(setting(part.row(0, named=True), assumed)) if assumed else "",
            recommend(part, limits, by, seed=seed),
        )
        for part in parts
    ]
