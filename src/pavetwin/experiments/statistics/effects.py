"""Shares of variation by factor: analysis of variance with the replicate as a block.

Within a replicate all cells share traffic, defects and segment, so the effect of a factor may differ between
replicates. A factor is therefore tested against its interaction with the replicate, not against the residual, which
would count one recording of traffic, flown in twelve cells, as twelve independent observations. That is the analysis of
variance for repeated measures, with the world, if it is varied, between
replicates (Kirk, Experimental Design, 4th ed., chapters 10 and 12).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import prod
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.linalg import helmert
from scipy.special import fdtrc

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.experiments.metrics import METRICS, REPLICATE, Metric
from pavetwin.experiments.statistics.cells import at_every_level, layout, values_of

RESIDUAL: Final = "residual"
TIMES: Final = " × "
"""Separates the factors of an interaction's name."""
EFFECT_ALPHA: Final = 0.01
"""Family-wise error of the terms called significant: small, since it adds to that of the differences."""


@dataclass(frozen=True)
class _Term:
    name: str
    df: int
    ss: float
    error_df: int = 0
    error_ss: float = 0.0
    """Error term of the test; none for replicates and the residual."""
    epsilon: float = 1.0
    """Greenhouse and Geisser's correction of both degrees of freedom."""
    observed: int = 0
    """Means of a replicate in a cell of the term, over all else: so many there are."""


def effects(table: pl.DataFrame, factors: Sequence[str], metrics: Sequence[Metric] = METRICS) -> pl.DataFrame:
    """Main effects and two-way interactions of `factors` on each metric.

    Factors with one level are dropped. Only replicates with a value in every cell are used, which keeps the terms apart
    from each other; a metric without such a replicate has no rows. Missions that differ in none of the factors are
    averaged. Those without a factor count at each of its levels.

    Columns: `metric`, `term` ("traffic", "traffic × policy"; then "replicate" and "residual", which is all that is
    left: higher interactions, and how the factors work differently from replicate to replicate), `df`, `ss`, `f`, `p`
    (by the degrees of freedom that Greenhouse and Geisser 1959 correct for unequal variances), `eta2` (share of the
    total sum of squares; these sum to 1), `omega2` (partial, at least 0: the variance that the term makes among the
    means of its cells, over that and their error: df (F − 1) / (df (F − 1) + replicates × cells of the term), Keren and
    Lewis 1979), `replicates` (used). `f`, `p`, `omega2` are null for the last two terms, and where too few replicates
    leave nothing to test against.
    """
    whole = at_every_level(table)
    rows = [row for metric in metrics for row in _of_metric(whole, list(factors), metric)]
    return pl.DataFrame(rows, schema=_SCHEMA, orient="row")


_SCHEMA: dict[str, Any] = {
    **{"metric": pl.String, "term": pl.String, "df": pl.Int64},
    **dict.fromkeys(("ss", "f", "p", "eta2", "omega2"), pl.Float64),
    "replicates": pl.Int64,
}


def _of_metric(table: pl.DataFrame, factors: Sequence[str], metric: Metric) -> list[tuple[object, ...]]:
    table = table.filter(~np.isnan(values_of(table, metric.name)))
    levels = {factor: table[factor].unique(maintain_order=True).to_list() for factor in factors if factor != "world"}
    within = {factor: len(values) for factor, values in levels.items() if len(values) > 1}
    values, worlds = _complete(table, metric, {factor: levels[factor] for factor in within})
    if not len(values):
        return []
    if "world" not in factors:
        worlds = np.zeros_like(worlds)
    # Equal values then differ by exactly nothing, not by the rounding of their mean.
    values -= values[0, 0]
    terms = _terms(values, worlds, within, factors)
    total = float(((values - values.mean()) ** 2).sum())
    left = max(total - sum(term.ss for term in terms), 0.0)
    terms.append(_Term(RESIDUAL, values.size - 1 - sum(term.df for term in terms), left))
    return [(metric.name, term.name, *_row(term, total), len(values)) for term in terms]


def _complete(table: pl.DataFrame, metric: Metric, levels: dict[str, list[object]]) -> tuple[Float64Array, IndexArray]:
    """(replicates, cells) values of the replicates that have one in every cell, and (replicates,) their worlds."""
    cells = layout(table, list(levels))
    number = {key: at for at, key in enumerate(cells.keys)}
    wanted = [number.get(key) for key in product(*levels.values())]
    if None in wanted or not table.height:
        return np.empty((0, 1)), np.empty(0, dtype=np.intp)
    values = cells.means(values_of(table, metric.name))[np.array(wanted, dtype=np.intp)].T
    whole = ~np.isnan(values).any(axis=1)
    return values[whole], cells.worlds[whole]


def _terms(values: Float64Array, worlds: IndexArray, within: dict[str, int], factors: Sequence[str]) -> list[_Term]:
    """Every term but the residual; `within` has the number of levels of each factor that varies within replicates."""
    varied = [factor for factor in factors if factor in within or (factor == "world" and len(np.unique(worlds)) > 1)]
    split: dict[frozenset[str], _Term] = {}
    for names in [(), *((factor,) for factor in within), *combinations(within, 2)]:
        observed = len(values) * prod(within[name] for name in names)
        between, inside = _split(values @ _contrasts(within, names), worlds, observed)
        split[frozenset(names)] = inside
        if between is not None and len(names) < 2:
            split[frozenset((*names, "world"))] = between
    wanted = [(factor,) for factor in varied] + list(combinations(varied, 2))
    named = [replace(split[frozenset(names)], name=TIMES.join(names)) for names in wanted]
    blocks = split[frozenset()]
    return [*named, _Term(REPLICATE, blocks.error_df, blocks.error_ss)]


def _contrasts(within: dict[str, int], names: Sequence[str]) -> Float64Array:
    """(cells, df) orthonormal contrasts of a term: Helmert's for its factors, the mean over the others."""
    columns = np.ones((1, 1))
    for factor, levels in within.items():
        part = helmert(levels).T if factor in names else np.full((levels, 1), levels**-0.5)
        columns = np.kron(columns, part)
    return columns


def _split(scores: Float64Array, worlds: IndexArray, observed: int) -> tuple[_Term | None, _Term]:
    """Sums of squares of (replicates, df) contrast scores: between worlds, and of their mean against the rest.

    Between worlds is None when there is one.
    """
    known, world = np.unique(worlds, return_inverse=True)
    sizes = np.bincount(world)
    means = np.stack([scores[world == number].mean(axis=0) for number in range(len(known))])
    mean, df = scores.mean(axis=0), scores.shape[1]
    rest = scores - means[world]
    error_df, error_ss = df * (len(scores) - len(known)), float((rest**2).sum())
    epsilon = _epsilon(rest)
    inside = _Term("", df, len(scores) * float((mean**2).sum()), error_df, error_ss, epsilon, observed)
    if len(known) == 1:
        return None, inside
    between_ss = float((sizes @ (means - mean) ** 2).sum())
    return _Term("", df * (len(known) - 1), between_ss, error_df, error_ss, epsilon, observed), inside


def _epsilon(rest: Float64Array) -> float:
    """Greenhouse and Geisser's ε of residual scores: 1 where contrasts vary alike, at least 1 / df."""
    covariance = rest.T @ rest
    squares = float((covariance**2).sum())
    return float(np.trace(covariance)) ** 2 / (rest.shape[1] * squares) if squares > 0 else 1.0


def _row(term: _Term, total: float) -> tuple[object, ...]:
    """df, ss, f, p, eta2, omega2."""
    eta2 = term.ss / total if total > 0 else None
    # An error sum of squares that is only rounding measures no variance.
    if not term.error_df or term.error_ss <= 1e-12 * total:
        return term.df, term.ss, None, None, eta2, None
    f = term.ss / term.df / (term.error_ss / term.error_df)
    p = float(fdtrc(term.epsilon * term.df, term.epsilon * term.error_df, f))
    gain = term.df * (f - 1)
    return term.df, term.ss, f, p, eta2, max(gain / (gain + term.observed), 0.0)


def significant_terms(effects: pl.DataFrame, metric: str) -> list[str]:
    """The terms with p < `EFFECT_ALPHA` after Holm's correction for all terms of a metric, the largest share first."""
    rows = effects.filter(pl.col("metric") == metric).drop_nulls(["eta2", "p"]).sort("eta2", descending=True).to_dicts()
    corrected = holm(np.array([row["p"] for row in rows], dtype=np.float64))
    return [row["term"] for row, p in zip(rows, corrected, strict=True) if p < EFFECT_ALPHA]


def holm(p: Float64Array) -> Float64Array:
    """p-values corrected for being the smallest of many (Holm 1979): holds the family-wise error under any dependence.

    Args:
        p: (comparisons,) NaN where there was no test; such are not part of the family.
    """
    corrected = np.full(len(p), np.nan)
    tested = np.flatnonzero(~np.isnan(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    steps = p[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected
