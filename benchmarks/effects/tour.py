"""Before and after: what the twin told of each world as it was, and what it tells now; each flies its proposal."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from benchmarks.calibration import by_resampling
from benchmarks.effects.sizes import MEASURED, Option, compared, proposed
from pavetwin.experiments.advice import advise
from pavetwin.experiments.metrics import BATTERIES, COMPARED, TOUR_METRICS
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.experiments.statistics.cells import layout, values_of
from pavetwin.experiments.statistics.proposal import batteries_to_bring
from pavetwin.experiments.tours import by_mission

SEGMENTS: Final = 12
METRICS: Final = (*MEASURED, *TOUR_METRICS)
BY: Final = ("altitude_m", "policy")


@dataclass(frozen=True)
class Told:
    """What the twin tells of one inspection."""

    option: Option
    certainty: float | None
    """The probability that it says the proposal is the best with."""
    batteries: int | None
    """To bring to a tour; None of a mission over one segment."""


@dataclass(frozen=True)
class Tour:
    """One world."""

    world: str
    before: Told
    after: Told
    length_m: float
    """Mean length of the street that a mission inspects."""
    defects: float
    """Mean number of defects on it."""
    missions: pl.DataFrame
    """A row a metric of `METRICS`: each side's own proposal as it is flown there, see `Effect.flight`."""


def tours(before: pl.DataFrame, after: pl.DataFrame, limits: MissionLimits) -> list[Tour]:
    """Both studies world by world; where their missions are tours, as whole missions."""
    found = []
    for world in after["world"].unique(maintain_order=True).to_list():
        was, now = (by_mission(table.filter(world=world)) for table in (before, after))
        options = proposed(was, limits), proposed(now, limits)
        sides = {
            side: table.filter(altitude_m=option[0], policy=option[1])
            for side, table, option in zip(("before", "after"), (was, now), options, strict=True)
        }
        told = (
            Told(options[0], naive_certainty(was, limits), _bring(was, limits)),
            Told(options[1], _certainty(now, limits), _bring(now, limits)),
        )
        length_m, defects = (float(now.select(pl.col(name).mean()).item()) for name in ("length_m", "defects"))
        missions = compared(sides, METRICS if BATTERIES in now.columns else MEASURED)
        found.append(Tour(world, *told, length_m, defects, missions))
    return found


def naive_certainty(table: pl.DataFrame, limits: MissionLimits) -> float:
    """How often the proposal is the best of resampled replicates: what `recommend` said before it shrank means."""
    cells = layout(table, BY)
    units = np.stack([cells.means(values_of(table, name)) for name in COMPARED])
    return float(by_resampling(units, limits, seed=0)[cells.keys.index(proposed(table, limits))])


def _certainty(table: pl.DataFrame, limits: MissionLimits) -> float | None:
    best = advise(table, limits)[0].recommendation.best
    return None if best is None else best["certainty"]


def _bring(table: pl.DataFrame, limits: MissionLimits) -> int | None:
    if BATTERIES not in table.columns:
        return None
    recommendation = advise(table, limits)[0].recommendation
    option = recommendation.best or recommendation.nearest
    assert option is not None, "every study has missions with a coverage"
    return batteries_to_bring(option)
