"""Cracks alone: from how high each camera still shows them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from benchmarks.effects.catalogue import USUAL, Variant
from benchmarks.effects.sizes import ALL, FLIGHT, MEASURED, option_text, proposed, within
from benchmarks.effects.words import markdown
from pavetwin.experiments.ground_view import GroundView, ground_view
from pavetwin.experiments.statistics import MissionLimits, summarise
from pavetwin.experiments.statistics.bootstrap import resamples, strata
from pavetwin.experiments.statistics.cells import layout, values_of
from pavetwin.experiments.words import number, shown

COVERAGE: Final = MEASURED[0]
TOLERANCE: Final = 0.05
"""Of what is found: so much may a flight lose against the altitude that finds most."""
WITHIN_S: Final = 50.0
"""A limit of time under which the lowest altitude, which takes most passes, is no option."""


@dataclass(frozen=True)
class Highest:
    """The highest of the altitudes flown that loses no more than `TOLERANCE`, and its 95 % interval by resampling
    replicates."""

    altitude_m: float
    low_m: float
    high_m: float

    def __str__(self) -> str:
        """`15 m (10 to 30)`."""
        if self.low_m == self.high_m == self.altitude_m:
            return f"{self.altitude_m:g}\u00a0m"
        return f"{self.altitude_m:g}\u00a0m ({self.low_m:g} to {self.high_m:g})"


def highest(table: pl.DataFrame) -> Highest:
    """From how high hovering finds nearly what it finds from its best altitude."""
    hovering = table.filter(policy=FLIGHT[1]).sort("altitude_m", maintain_order=True)
    cells = layout(hovering, ["altitude_m"])
    altitudes = np.array([altitude_m for (altitude_m,) in cells.keys])
    units = cells.means(values_of(hovering, COVERAGE.name))
    defined = ~np.isnan(units)
    counts = np.concatenate([np.ones((1, units.shape[1])), resamples(strata(cells.worlds), seed=0)])
    means = (counts @ np.nan_to_num(units).T) / np.maximum(counts @ defined.T, 1)
    kept = means >= means.max(axis=1, keepdims=True) - TOLERANCE
    found = np.where(kept, altitudes, 0.0).max(axis=1)
    low_m, high_m = np.quantile(found[1:], [0.025, 0.975], method="nearest")
    return Highest(float(found[0]), float(low_m), float(high_m))


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
        rows.append([variant.title, *seen, *found, option_text(proposed(table, limits)), option_text(quick)])
    at = f"{FLIGHT[0]:g}\u00a0m"
    head = [f"a pixel at {at}, mm", f"seen from {at} along the flight: wider than, mm", "across it, mm"]
    heights = [f"found at {altitude_m:g}\u00a0m, %" for altitude_m in altitudes]
    return markdown(["", *head, *heights, "proposed", f"proposed within {WITHIN_S:g}\u00a0s"], rows)


def highest_table(flown: Mapping[str, pl.DataFrame], variants: Sequence[Variant], limits: MissionLimits) -> str:
    """In each world and in all: the highest altitude that loses little, and what is proposed without a limit."""
    worlds = [*flown[variants[0].name]["world"].unique(maintain_order=True).to_list(), ALL]
    rows = []
    for variant in sorted(variants, key=lambda variant: -_view(variant).pixel_m):
        tables = [within(flown[variant.name], world) for world in worlds]
        told = [f"{highest(table)}; {option_text(proposed(table, limits))}" for table in tables]
        rows.append([variant.title, number(1000 * _view(variant).pixel_m, 1), *told])
    return markdown(["", f"a pixel at {FLIGHT[0]:g}\u00a0m, mm", *worlds], rows)


def _view(variant: Variant) -> GroundView:
    option = {"altitude_m": FLIGHT[0], "preset": "default", "sensor": "recall"}
    return ground_view(option, {"set": {**USUAL, **variant.settings}})
