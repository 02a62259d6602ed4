"""Calibration of the probabilities of `recommend` in simulated studies with a known truth.

    python -m benchmarks.calibration

prints the numbers of docs/explanation/statistics.md, next to those of resampling without shrinkage.

A study has three altitudes and four policies, 10 or 20 replicates, and the paired structure of the paper's study over
the demo's town (seed 1): its variances between replicates, of replicate by altitude, of replicate by policy and within;
differences of policies that are 0 in most replicates, since traffic hides a segment's defects in some only; shares of
30 defects; times with a heavy tail. Other objectives than the most found have studies of their own, in which less is
found from higher up, which takes less time, and a share of the defects is required that at least one option finds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.stats import beta

from pavetwin.experiments.metrics import COMPARED
from pavetwin.experiments.statistics.bootstrap import resamples
from pavetwin.experiments.statistics.choice import MissionLimits, Objective, best_among, choice_under, keeping

ALTITUDES, POLICIES = 3, 4
ALTITUDE = np.repeat(np.arange(ALTITUDES), POLICIES)
ALTITUDES_M = np.array([6.0, 15.0, 30.0])[ALTITUDE]
POLICY = np.tile(np.arange(POLICIES), ALTITUDES)
OPTIONS: Final = ALTITUDES * POLICIES
REPLICATES: Final = (10, 20)
SEEDS: Final = 30
SEEDS_OF_OBJECTIVES: Final = 100
EDGES: Final = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)

PAPER: Final[dict[str, tuple[list[float], list[float], float]]] = {
    "low": (
        [0.551, 0.584, 0.586, 0.558, 0.833, 0.838, 0.837, 0.838, 0.838, 0.842, 0.842, 0.847],
        [72, 76, 75, 83, 72, 75, 74, 83, 73, 75, 74, 81],
        0.1,
    ),
    "medium": (
        [0.541, 0.571, 0.569, 0.549, 0.826, 0.838, 0.835, 0.832, 0.833, 0.840, 0.837, 0.842],
        [72, 102, 79, 88, 72, 94, 79, 87, 73, 97, 78, 92],
        0.15,
    ),
    "high": (
        [0.494, 0.602, 0.571, 0.522, 0.776, 0.828, 0.796, 0.813, 0.781, 0.830, 0.801, 0.841],
        [72, 275, 93, 107, 72, 243, 89, 107, 73, 210, 91, 116],
        0.5,
    ),
}
"""Mean coverage and time of the paper's study by traffic, and the share of replicates in which policies differ."""

SHORTEST_S: Final = 72.0
REPLICATE, BY_ALTITUDE, BY_POLICY, WITHIN = 0.053, 0.038, 0.042, 0.035
"""Standard deviations of coverage; the last two in replicates in which policies differ."""
DEFECTS: Final = 30


@dataclass(frozen=True)
class Truth:
    """True means of a simulated study, by option."""

    coverage: np.ndarray
    time_s: np.ndarray
    busy: float
    """Share of the replicates in which policies differ."""
    limits: MissionLimits = field(default_factory=MissionLimits)
    objective: Objective = Objective.MOST_FOUND

    @property
    def kept(self) -> np.ndarray:
        """(options,) whether each keeps the limits."""
        return keeping(self._means, self.limits)[0]

    @property
    def best(self) -> np.ndarray:
        """(options,) whether each is the best of those; by coverage alone where that decides."""
        if self.objective is Objective.MOST_FOUND:
            coverage = np.where(self.kept, self.coverage, -1.0)
            return np.asarray(self.kept & (coverage >= coverage.max() - 1e-9))
        return best_among(self._means, self.kept[np.newaxis], self.objective, ALTITUDES_M)[0]

    @property
    def _means(self) -> np.ndarray:
        return np.stack([self.coverage, self.time_s, self.time_s / 1800])[:, np.newaxis]


def truth(kind: str, rng: np.random.Generator) -> Truth:
    """Draw a truth of one of the `KINDS`."""
    extra = np.array([0.0, rng.lognormal(np.log(60), 0.8), rng.uniform(5, 20), rng.uniform(10, 35)])
    time_s = SHORTEST_S + extra[POLICY] * rng.uniform(0.8, 1.1, ALTITUDES)[ALTITUDE]
    busy, limit = float(rng.choice([0.15, 0.3, 0.5])), None
    altitude = np.array([-rng.uniform(0.02, 0.25), 0.0, rng.normal(0, 0.02)])[ALTITUDE]
    policy = np.array([0.0, *rng.uniform(0, 0.05, POLICIES - 1)])[POLICY]
    if kind in OBJECTIVES:
        falls = np.array([0.0, *rng.uniform(0.02, 0.15, ALTITUDES - 1)]).cumsum()
        coverage = rng.uniform(0.45, 0.8) - falls[ALTITUDE] + policy + rng.normal(0, 0.003, OPTIONS)
        time_s = time_s + np.array([rng.uniform(10, 40), rng.uniform(0, 10), 0.0])[ALTITUDE]
        least = MissionLimits(min_coverage=float(rng.uniform(coverage.min(), coverage.max())))
        return Truth(coverage, time_s, busy, least, OBJECTIVES[kind])
    if kind == "as in the paper's study":
        coverage, times, busy = PAPER[str(rng.choice(list(PAPER)))]
        return Truth(np.array(coverage), np.array(times), busy)
    if kind in ("main effects", "limit of time"):
        coverage = 0.8 + altitude + policy + rng.normal(0, 0.003, OPTIONS)
    else:
        coverage = 0.8 + rng.normal(0, _SPREAD[kind], OPTIONS)
    if kind == "one leader":
        coverage[rng.integers(OPTIONS)] += 0.05
    if kind == "limit of time":
        limit = max(75.0, float(rng.choice(time_s[POLICY > 0])) * rng.uniform(0.9, 1.15))
    return Truth(coverage, time_s, busy, MissionLimits(max_time_s=limit))


_SPREAD: Final = {"unstructured": 0.02, "near ties": 0.005, "nearly equal": 0.001, "one leader": 0.003}
KINDS: Final = ("as in the paper's study", "main effects", "limit of time", *_SPREAD)
OBJECTIVES: Final = {"the highest altitude": Objective.HIGHEST, "the least time": Objective.FASTEST}
"""Kinds of truth in which something else than coverage decides."""


def simulated(known: Truth, replicates: int, rng: np.random.Generator) -> np.ndarray:
    """(3, options, replicates) coverage, time and energy with these true means."""
    busy = rng.random(replicates) < known.busy
    least = np.array([known.coverage[at == ALTITUDE].min() for at in range(ALTITUDES)])[ALTITUDE]
    gain = (known.coverage - least)[:, np.newaxis] / known.busy
    gain = gain + rng.normal(0, BY_POLICY, (POLICIES, replicates))[POLICY]
    gain = gain + rng.normal(0, WITHIN, (OPTIONS, replicates))
    street = rng.normal(0, REPLICATE, replicates) + rng.normal(0, BY_ALTITUDE, (ALTITUDES, replicates))[ALTITUDE]
    shares = least[:, np.newaxis] + street + busy * gain
    coverage = np.floor(DEFECTS * shares + rng.random(replicates)) / DEFECTS  # rounded without bias
    heavy = np.where(POLICY == 1, 1.0, 0.4)[:, np.newaxis]
    tail = 0.9 * rng.normal(size=(POLICIES, replicates))[POLICY] + 0.4 * rng.normal(size=(OPTIONS, replicates))
    waits = rng.random(replicates) < 0.6
    extra = (known.time_s - SHORTEST_S)[:, np.newaxis] * waits / 0.6
    length = rng.gamma(16, 1 / 16, replicates)
    time_s = SHORTEST_S * length + extra * np.exp(heavy * tail - heavy**2 * (0.9**2 + 0.4**2) / 2)
    return np.stack([coverage, time_s, time_s / 1800])


def by_resampling(
    units: np.ndarray, limits: MissionLimits, seed: int, objective: Objective = Objective.MOST_FOUND
) -> np.ndarray:
    """(options,) share of resamples of the replicates in which each option is the best."""
    counts = resamples((units.shape[2],), seed)
    means = np.einsum("mor,nr->mno", units, counts) / units.shape[2]
    return np.asarray(best_among(means, keeping(means, limits), objective, ALTITUDES_M).mean(axis=0))


def proposed(means: np.ndarray, known: Truth) -> int | None:
    """The option that `recommend` proposes by (3, options) observed means; None where none keeps the limits."""
    kept = keeping(means[:, np.newaxis], known.limits)[0]
    ahead = {**dict(zip(COMPARED, (-means[0], *means[1:]), strict=True)), "altitude_m": -ALTITUDES_M}
    order = [ahead[name] for name in dict.fromkeys((*known.objective.order, *COMPARED))]
    return int(np.lexsort([*reversed(order), ~kept])[0]) if kept.any() else None


def outcomes(seeds: int = SEEDS, kinds: Sequence[str] = KINDS) -> Iterator[dict[str, Any]]:
    """One row per study with an answer: the claims about the proposed option, and the truth."""
    worlds = [np.zeros(count, dtype=np.intp) for count in REPLICATES]
    for seed in range(seeds):
        for kind in kinds:
            rng = np.random.default_rng([seed, (*KINDS, *OBJECTIVES).index(kind)])
            known = truth(kind, rng)
            for count, blocks in zip(REPLICATES, worlds, strict=True):
                units = simulated(known, count, rng)
                chances = choice_under(
                    known.limits, units, blocks, (ALTITUDE, POLICY), seed,
                    objective=known.objective, altitudes_m=ALTITUDES_M,
                )  # fmt: skip
                at = proposed(means := units.mean(axis=2), known)
                if at is None or not known.best.any():
                    continue
                yield {
                    "kind": kind,
                    "replicates": count,
                    "resampled": float(by_resampling(units, known.limits, seed, known.objective)[at]),
                    "shrunk": float(chances.certainty[at]),
                    "right": bool(known.best[at]),
                    "keeps": float(chances.kept[at]),
                    "kept": bool(known.kept[at]),
                    "error_resampled": float(means[0, at] - known.coverage[at]),
                    "error_shrunk": float(chances.expected[0, at] - known.coverage[at]),
                }


def calibration(rows: pl.DataFrame, claim: str) -> pl.DataFrame:
    """Studies, mean claim, share right and its 95 % interval (Clopper and Pearson), by bins of the claim."""
    binned = rows.with_columns(bin=pl.col(claim).cut(list(EDGES[1:-1]), left_closed=True, labels=_BINS))
    table = binned.group_by("bin").agg(
        pl.len().alias("studies"), pl.col(claim).mean().alias("claimed"), pl.col("right").sum().alias("hits")
    )
    n, hits = table["studies"].to_numpy(), table["hits"].to_numpy()
    low, high = beta.ppf(0.025, hits, n - hits + 1), beta.ppf(0.975, hits + 1, n - hits)
    shares = {"right": hits / n, "low": np.nan_to_num(low), "high": np.where(hits == n, 1.0, high)}
    return table.with_columns(**{name: pl.Series(values) for name, values in shares.items()}).sort("claimed")


_BINS: Final = [f"{100 * low:.0f}–{100 * high:.0f}" for low, high in pairwise(EDGES)]


def tables(rows: pl.DataFrame, kinds: Sequence[str] = KINDS) -> str:
    """Calibration of both claims, and claims and errors of the coverage by kind of truth, in Markdown."""
    lines = ["| claimed, % | resampled: studies | right, % | shrunk: studies | right, % |", "|---|---:|---|---:|---|"]
    sides = [{row["bin"]: row for row in calibration(rows, claim).iter_rows(named=True)} for claim in _CLAIMS]
    for name in _BINS:
        cells = [
            f"{side[name]['studies']} | {100 * side[name]['right']:.0f} "
            f"({100 * side[name]['low']:.0f} to {100 * side[name]['high']:.0f})"
            if name in side
            else "0 | –"
            for side in sides
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines += [
        "",
        "| truth | studies | right, % | claimed, resampled | shrunk | coverage too high by, observed | shrunk |",
    ]
    lines += ["|---|" + "---:|" * 6]
    for kind in (*kinds, "all"):
        part = rows if kind == "all" else rows.filter(kind=kind)
        shares = [100 * _mean(part, name) for name in ("right", *_CLAIMS)]
        errors = [100 * _mean(part, name) for name in ("error_resampled", "error_shrunk")]
        numbers = [*(f"{share:.0f}" for share in shares), *(f"{error:+.1f}" for error in errors)]
        lines.append(f"| {kind} | {part.height} | {' | '.join(numbers)} |")
    return "\n".join(lines)


def kept_table(rows: pl.DataFrame) -> str:
    """Share of proposed options that keep the limits, by the probability claimed, in Markdown."""
    lines = ["| claimed to keep the limit, % | studies | keep it, % |", "|---|---:|---|"]
    for row in calibration(rows.with_columns(right="kept"), "keeps").iter_rows(named=True):
        share = f"{100 * row['right']:.0f} ({100 * row['low']:.0f} to {100 * row['high']:.0f})"
        lines.append(f"| {row['bin']} | {row['studies']} | {share} |")
    lines.append(f"| all: {100 * _mean(rows, 'keeps'):.0f} | {rows.height} | {100 * _mean(rows, 'kept'):.0f} |")
    return "\n".join(lines)


_CLAIMS: Final = ("resampled", "shrunk")


def _mean(rows: pl.DataFrame, name: str) -> float:
    return float(rows[name].cast(pl.Float64).mean())  # type: ignore[arg-type]


def main() -> None:
    rows = pl.DataFrame(list(outcomes()))
    print(tables(rows))
    others = pl.DataFrame(list(outcomes(SEEDS_OF_OBJECTIVES, tuple(OBJECTIVES))))
    print("", tables(others, tuple(OBJECTIVES)), "", kept_table(others), sep="\n")


if __name__ == "__main__":
    main()
