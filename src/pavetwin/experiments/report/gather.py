"""A study from its table: every statistic that its report shows, computed once."""

from collections.abc import Mapping
from typing import Any

import polars as pl

from pavetwin.experiments.metrics import REPLICATE, metrics_in
from pavetwin.experiments.references import references
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.statistics import Comparison, conclusions, differences, effects, summarise
from pavetwin.world.model import World


def gather(
    title: str, design: Mapping[str, Any], table: pl.DataFrame, worlds: Mapping[str, World], *, seed: int = 0
) -> Study:
    """The statistics of a table over everything that it varies.

    Args:
        design: plain values of `design.yaml`, and the `version` that flew it.
        worlds: by the names in the table; those that are not here get no map.
        seed: of the resamples.
    """
    by = table.columns[: table.columns.index(REPLICATE)]
    factors = tuple(name for name in by if table[name].n_unique() > 1)
    summary = summarise(table, by, metrics_in(table), seed=seed)
    levels = {name: table[name].unique(maintain_order=True).to_list() for name in by}
    compared = [
        Comparison(factor, reference, reason, differences(table, by, factor=factor, reference=reference, seed=seed))
        for factor, (reference, reason) in references(levels, design).items()
    ]
    explained = effects(table, factors)
    sentences = conclusions(summary, compared, explained)
    return Study(title, design, factors, table, summary, compared, explained, sentences, worlds)
