"""Cracks alone: from how high each camera still shows them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from benchmarks.effects.catalogue import USUAL, Variant
from benchmarks.effects.sizes import ALL, FLIGHT, MEASURED, Option, option_text, proposed, within
from benchmarks.effects.words import markdown
from pavetwin.arrays import Float64Array
from pavetwin.experiments.advice import advise
from pavetwin.experiments.ground_view import GroundView, ground_view
from pavetwin.experiments.statistics import MissionLimits, Objective, summarise
from pavetwin.experiments.statistics.bootstrap import resamples, strata
from pavetwin.experiments.statistics.cells import layout, values_of
from pavetwin.experiments.words import shown
from pavetwin.reports.words import MISSING, number, percent

COVERAGE: Final = MEASURED[0]
QUARTER: Final = 0.25
"""Of all cracks."""
WITHIN_S: Final = 50.0
"""A limit of time under which the lowest altitude, which takes most passes, is no option."""


@dataclass(frozen=True)
class Reach:
    """From how high hovering finds a share of all cracks, linear between the altitudes flown, and its 95 % interval by
    resampling replicates: 0 where the lowest finds less, infinite where the highest finds it still."""

    altitude_m: float
    low_m: float
    high_m: float
    lowest_m: float
    highest_m: float

    def __str__(self) -> str:
        """`19 m (15 to 24)`, `under 6 m`, `over 60 m`."""
        words = [self._words(each_m) for each_m in (self.altitude_m, self.low_m, self.high_m)]
        if len(set(words)) == 1:
            return f"{words[0]}\u00a0m"
        return f"{words[0]}\u00a0m ({words[1]} to {words[2]})"

    def _words(self, altitude_m: float) -> str:
        if altitude_m == 0:
            return f"under {self.lowest_m:g}"
        return f"over {self.highest_m:g}" if np.isinf(altitude_m) else number(altitude_m, 0)


def reach(table: pl.DataFrame, share: float = QUARTER) -> Reach:
    """The altitude above which hovering finds less than a share."""
    hovering = table.filter(policy=FLIGHT[1]).sort("altitude_m", maintain_order=True)
    cells = layout(hovering, ["altitude_m"])
    altitudes = np.array([altitude_m for (altitude_m,) in cells.keys])
    units = cells.means(values_of(hovering, COVERAGE.name))
    counts = np.concatenate([np.ones((1, units.shape[1])), resamples(strata(cells.worlds), seed=0)])
    means = (counts @ np.nan_to_num(units).T) / np.maximum(counts @ np.isfinite(units).T, 1)
    reached = np.array([_crossing(altitudes, row, share) for row in means])
    low_m, high_m = np.quantile(reached[1:], [0.025, 0.975], method="nearest").tolist()
    return Reach(float(reached[0]), low_m, high_m, float(altitudes[0]), float(altitudes[-1]))


def _crossing(altitudes: Float64Array, found: Float64Array, share: float) -> float:
    """Where what is found falls below a share, going up."""
    below = np.flatnonzero(found < share)
    if not len(below):
        return np.inf
    at = int(below[0])
    return float(np.interp(-share, -found[at - 1 : at + 1], altitudes[at - 1 : at + 1])) if at else 0.0


@dataclass(frozen=True)
class Highest:
    """What `recommend` proposes as the highest altitude from which a share is found."""

    option: Option | None
    """None where no option finds as much."""
    certainty: float | None = None
    """The probability that it finds as much and none higher does."""

    def __str__(self) -> str:
        """`hover, 15 m (83 %)`, `none`."""
        if self.option is None:
            return "none"
        return f"{option_text(self.option)} ({MISSING if self.certainty is None else percent(self.certainty)})"


def highest(table: pl.DataFrame, share: float = QUARTER) -> Highest:
    """Of all altitudes and policies."""
    (advice,) = advise(table, MissionLimits(min_coverage=share), objective=Objective.HIGHEST)
    best = advice.recommendation.best
    return Highest(None) if best is None else Highest((best["altitude_m"], best["policy"]), best["certainty"])


def cracks_table(flown: Mapping[str, pl.DataFrame], variants: Sequence[Variant], limits: MissionLimits) -> str:
    """What each camera resolves, what hovering finds by altitude, and what is proposed, over all worlds."""
    altitudes = sorted(set(flown[variants[0].name]["altitude_m"].to_list()))
    rows = []
    for variant in variants:
        table, view = flown[variant.name], _view(variant)
        hovering = summarise(table.filter(policy=FLIGHT[1]), ["altitude_m"], [COVERAGE])
        found = [shown(COVERAGE, hovering.filter(altitude_m=altitude_m)["mean"][0]) for altitude_m in altitudes]
        quick = proposed(table, MissionLimits(max_time_s=WITHIN_S))
        lengths = (view.pixel_m, view.unseen_along_m["single_crack"], view.unseen_m["single_crack"])
        seen = [number(1000 * length_m, 1) for length_m in lengths]
        options = [option_text(proposed(table, limits)), option_text(quick), str(highest(table))]
        rows.append([variant.title, *seen, *found, *options])
    at = f"{FLIGHT[0]:g}\u00a0m"
    head = [f"a pixel at {at}, mm", f"seen from {at} along the flight: wider than, mm", "across it, mm"]
    heights = [f"found at {altitude_m:g}\u00a0m, %" for altitude_m in altitudes]
    options = [
        "proposed",
        f"proposed within {WITHIN_S:g}\u00a0s",
        "highest altitude with at least a quarter found",
    ]
    return markdown(["", *head, *heights, *options], rows)


def reach_table(flown: Mapping[str, pl.DataFrame], variants: Sequence[Variant]) -> str:
    """In each world and in all, from how high each camera finds a quarter of all cracks."""
    worlds = [*flown[variants[0].name]["world"].unique(maintain_order=True).to_list(), ALL]
    rows = []
    for variant in sorted(variants, key=lambda variant: -_view(variant).pixel_m):
        reaches = [str(reach(within(flown[variant.name], world))) for world in worlds]
        rows.append([variant.title, number(1000 * _view(variant).pixel_m, 1), *reaches])
    return markdown(["a quarter is found up to", f"a pixel at {FLIGHT[0]:g}\u00a0m, mm", *worlds], rows)


def _view(variant: Variant) -> GroundView:
    option = {"altitude_m": FLIGHT[0], "preset": "default", "sensor": "recall"}
    return ground_view(option, {"set": {**USUAL, **variant.settings}})
