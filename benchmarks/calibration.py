"""How often `recommend` is right when it says how sure it is: simulated studies whose truth is known.

    python -m benchmarks.calibration                 prints the tables of docs/explanation/statistics.md
    python -m benchmarks.calibration --plot FILE     and draws docs/images/calibration.svg

A study has three altitudes and four policies, 10 or 20 replicates, and the paired structure of the paper's study over
the demo's town (seed 1): its variances between replicates, of replicate by altitude, of replicate by policy and within;
differences of policies that are 0 in most replicates, since traffic hides a segment's defects in some only; shares of
30 defects; times with a heavy tail.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.stats import beta

from pavetwin.experiments.statistics.bootstrap import resamples
from pavetwin.experiments.statistics.recommend import MissionLimits, choice_under

ALTITUDES, POLICIES = 3, 4
ALTITUDE = np.repeat(np.arange(ALTITUDES), POLICIES)
POLICY = np.tile(np.arange(POLICIES), ALTITUDES)
OPTIONS: Final = ALTITUDES * POLICIES
REPLICATES: Final = (10, 20)
SEEDS: Final = 30
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
    """What a simulated study would find with endless replicates, by option."""

    coverage: np.ndarray
    time_s: np.ndarray
    busy: float
    """Share of the replicates in which policies differ."""
    max_time_s: float | None = None

    @property
    def best(self) -> np.ndarray:
        """(options,) which are the best within the limit."""
        allowed = np.ones(OPTIONS, dtype=bool) if self.max_time_s is None else self.time_s <= self.max_time_s
        coverage = np.where(allowed, self.coverage, -1.0)
        return np.asarray(allowed & (coverage >= coverage.max() - 1e-9))


def truth(kind: str, rng: np.random.Generator) -> Truth:
    """A truth of one of the `KINDS`, drawn."""
    extra = np.array([0.0, rng.lognormal(np.log(60), 0.8), rng.uniform(5, 20), rng.uniform(10, 35)])
    time_s = SHORTEST_S + extra[POLICY] * rng.uniform(0.8, 1.1, ALTITUDES)[ALTITUDE]
    busy, limit = float(rng.choice([0.15, 0.3, 0.5])), None
    altitude = np.array([-rng.uniform(0.02, 0.25), 0.0, rng.normal(0, 0.02)])[ALTITUDE]
    policy = np.array([0.0, *rng.uniform(0, 0.05, POLICIES - 1)])[POLICY]
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
    return Truth(coverage, time_s, busy, limit)


_SPREAD: Final = {"unstructured": 0.02, "near ties": 0.005, "nearly equal": 0.001, "one leader": 0.003}
KINDS: Final = ("as in the paper's study", "main effects", "limit of time", *_SPREAD)


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


def by_resampling(units: np.ndarray, limits: MissionLimits, seed: int) -> np.ndarray:
    """(options,) how often each is the best of resampled replicates: what was claimed before."""
    counts = resamples((units.shape[2],), seed)
    means = np.einsum("mor,nr->mno", units, counts) / units.shape[2]
    allowed = means[1] <= (np.inf if limits.max_time_s is None else limits.max_time_s)
    coverage = np.where(allowed, means[0], -1.0)
    best = allowed & (coverage >= coverage.max(axis=1, keepdims=True) - 1e-9)
    time_s = np.where(best, means[1], np.inf)
    return np.asarray((best & (time_s <= time_s.min(axis=1, keepdims=True) + 1e-7)).mean(axis=0))


def outcomes(seeds: int = SEEDS, kinds: tuple[str, ...] = KINDS) -> Iterator[dict[str, Any]]:
    """One row a study that has an answer: what was claimed of the proposed option, and what is true."""
    worlds = [np.zeros(count, dtype=np.intp) for count in REPLICATES]
    for seed in range(seeds):
        for kind in kinds:
            rng = np.random.default_rng([seed, KINDS.index(kind)])
            known = truth(kind, rng)
            limits = MissionLimits(max_time_s=known.max_time_s)
            for count, blocks in zip(REPLICATES, worlds, strict=True):
                units = simulated(known, count, rng)
                chances = choice_under(limits, units, blocks, (ALTITUDE, POLICY), seed)
                means = units.mean(axis=2)
                allowed = means[1] <= (limits.max_time_s or np.inf)
                if not allowed.any() or not known.best.any():
                    continue
                proposed = int(np.lexsort((means[1], -np.where(allowed, means[0], -1.0)))[0])
                yield {
                    "kind": kind,
                    "replicates": count,
                    "before": float(by_resampling(units, limits, seed)[proposed]),
                    "after": float(chances.certainty[proposed]),
                    "right": bool(known.best[proposed]),
                    "error_before": float(means[0, proposed] - known.coverage[proposed]),
                    "error_after": float(chances.expected[0, proposed] - known.coverage[proposed]),
                }


def calibration(rows: pl.DataFrame, claim: str) -> pl.DataFrame:
    """By bins of what was claimed: the studies, the mean claim, the share right and its 95 % interval
    (Clopper and Pearson)."""
    binned = rows.with_columns(bin=pl.col(claim).cut(list(EDGES[1:-1]), left_closed=True, labels=_BINS))
    table = binned.group_by("bin").agg(
        pl.len().alias("studies"), pl.col(claim).mean().alias("claimed"), pl.col("right").sum().alias("hits")
    )
    n, hits = table["studies"].to_numpy(), table["hits"].to_numpy()
    low, high = beta.ppf(0.025, hits, n - hits + 1), beta.ppf(0.975, hits + 1, n - hits)
    shares = {"right": hits / n, "low": np.nan_to_num(low), "high": np.where(hits == n, 1.0, high)}
    return table.with_columns(**{name: pl.Series(values) for name, values in shares.items()}).sort("claimed")


_BINS: Final = [f"{100 * low:.0f}–{100 * high:.0f}" for low, high in pairwise(EDGES)]


def tables(rows: pl.DataFrame) -> str:
    """In Markdown: calibration before and after, and by kind of truth the claims and the error of the coverage."""
    lines = ["| claimed, % | before: studies | right, % | after: studies | right, % |", "|---|---:|---|---:|---|"]
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
    lines += ["", "| truth | studies | right, % | claimed before | after | coverage too high by, before | after |"]
    lines += ["|---|" + "---:|" * 6]
    for kind in (*KINDS, "all"):
        part = rows if kind == "all" else rows.filter(kind=kind)
        shares = [100 * _mean(part, name) for name in ("right", *_CLAIMS)]
        errors = [100 * _mean(part, name) for name in ("error_before", "error_after")]
        numbers = [*(f"{share:.0f}" for share in shares), *(f"{error:+.1f}" for error in errors)]
        lines.append(f"| {kind} | {part.height} | {' | '.join(numbers)} |")
    return "\n".join(lines)


_CLAIMS: Final = ("before", "after")


def _mean(rows: pl.DataFrame, name: str) -> float:
    return float(rows[name].cast(pl.Float64).mean())  # type: ignore[arg-type]


def plot(rows: pl.DataFrame, file: Path) -> None:
    """Share right over what was claimed, before and after."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "calibration"
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(5.2, 4.6), layout="constrained")
    axes.plot([0, 100], [0, 100], color="#9AA3AE", linewidth=1, label="claimed as often as right")
    for claim, colour, shift in (("before", "#C2571A", -0.6), ("after", "#1F6FB2", 0.6)):
        table = calibration(rows, claim)
        claimed, right = 100 * table["claimed"].to_numpy(), 100 * table["right"].to_numpy()
        spans = [right - 100 * table["low"].to_numpy(), 100 * table["high"].to_numpy() - right]
        label = f"{claim}: {'resampling alone' if claim == 'before' else 'shrunk means'}"
        axes.errorbar(
            claimed + shift, right, np.abs(spans), color=colour, marker="o", markersize=5, capsize=3, label=label
        )
    axes.set(xlim=(0, 102), ylim=(0, 102), xlabel="claimed probability of being the best, %", ylabel="right, %")
    axes.set_title(f"{rows.height} simulated studies; bars: 95 % intervals", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper left", fontsize=9)
    figure.savefig(file, metadata={"Date": None})


def main(arguments: list[str]) -> None:
    rows = pl.DataFrame(list(outcomes()))
    print(tables(rows))
    if arguments[:1] == ["--plot"]:
        plot(rows, Path(arguments[1]))


if __name__ == "__main__":
    main(sys.argv[1:])
