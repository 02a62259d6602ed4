"""What a study advises: a recommendation for each combination of its assumptions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import polars as pl

from pavetwin.config.settings import ALIASES
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import ENVIRONMENT
from pavetwin.experiments.ground_view import GroundView, ground_view
from pavetwin.experiments.metrics import INDEX_ERROR, REPLICATE, has_detected
from pavetwin.experiments.statistics import MissionLimits, Objective, Recommendation, recommend
from pavetwin.experiments.statistics.cells import levels_of
from pavetwin.experiments.statistics.recommend import UNMEASURED
from pavetwin.experiments.tours import by_mission
from pavetwin.experiments.words import setting
from pavetwin.reports.words import opened

ASSUMED = ("sensor", "preset")
"""Factors that are assumptions of a study, not options to choose from."""


@dataclass(frozen=True)
class Advice:
    assumption: str
    """The sensor and the preset as a sentence; empty where the study has one of each."""
    recommendation: Recommendation
    view: GroundView | None = None
    """From the option that is recommended or nearest; None where there is none, or the design is not known."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """The first says what to fly, and the second what the camera shows from there."""
        first, *others = self.recommendation.sentences
        return (first, *([self.view.sentence] if self.view else []), *others)


def advise(
    table: pl.DataFrame,
    limits: MissionLimits,
    *,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
    design: Mapping[str, Any] | None = None,
) -> list[Advice]:
    """A recommendation among altitudes, policies and swept settings, over the worlds and traffic of the table.

    Args:
        table: of segment missions; where these are parts of tours, whole missions are judged.
        design: plain values of `design.yaml`, for what the camera shows.

    Raises:
        PaveTwinError: an option that finds nothing may be the best by the objective, and nothing says what must be
            found; or it asks for the most accurate index, and no mission has one by what was detected.
    """
    table = by_mission(table)
    if INDEX_ERROR in objective.judged and not has_detected(table):
        raise PaveTwinError(f"`objective` {objective}: {UNMEASURED}; fly a study with the sensor 'detector'.")
    varied = table.columns[table.columns.index("altitude_m") : table.columns.index(REPLICATE)]
    given = {name for name in varied if ALIASES.get(name, name) in ENVIRONMENT}
    chosen_by = {name for name in varied if name not in {*ASSUMED, *given} and len(levels_of(table, name)) > 1}
    by = [name for name in varied if name in chosen_by | {"altitude_m", "policy"}]
    assumed = [name for name in ASSUMED if len(levels_of(table, name)) > 1]
    parts = table.partition_by(assumed, maintain_order=True) if assumed else [table]
    return [_advice(part, limits, objective, by, assumed, seed, design) for part in parts]


def _advice(
    table: pl.DataFrame,
    limits: MissionLimits,
    objective: Objective,
    by: list[str],
    assumed: list[str],
    seed: int,
    design: Mapping[str, Any] | None,
) -> Advice:
    made = recommend(table, limits, by, objective=objective, seed=seed)
    first = table.row(0, named=True)
    option = made.best or made.nearest
    view = ground_view({**first, **option}, design) if option and design else None
    return Advice(opened(setting(first, assumed)) if assumed else "", made, view)
