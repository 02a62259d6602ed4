"""How many of a hundred nominal 95 % intervals of a mean hold it: ours against scipy's and Student's.

`python -m benchmarks.coverage` prints a table in Markdown; `docs/decisions` quotes it.
"""

import time
from collections.abc import Callable
from typing import Final

import numpy as np
from scipy import stats

from pavetwin.experiments.statistics.bootstrap import intervals
from pavetwin.experiments.statistics.flips import sign_flip_p

SAMPLES: Final = 1000
RESAMPLES: Final = 1999
BATCH: Final = 50
"""Samples that scipy resamples at a time, to bound memory."""

PAIRS: Final = 16
"""Of the exact sign-flip tests that are timed."""

Limits = tuple[np.ndarray, np.ndarray]


def waiting(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Seconds: six in ten missions wait for nothing, the others lognormally long."""
    return np.where(rng.random(shape) < 0.6, 0.0, rng.lognormal(3, 1, shape))


def shares(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Of 6 defects, found with a chance that varies between streets around 0.95."""
    return rng.binomial(6, rng.beta(7.6, 0.4, shape)) / 6


KINDS: Final[dict[str, tuple[Callable[[np.random.Generator, tuple[int, int]], np.ndarray], float]]] = {
    "normal": (lambda rng, shape: rng.normal(0, 1, shape), 0.0),
    "lognormal (σ = 1)": (lambda rng, shape: rng.lognormal(0, 1, shape), float(np.exp(0.5))),
    "waiting": (waiting, float(0.4 * np.exp(3.5))),
    "shares around 0.95": (shares, 0.95),
}


def ours(values: np.ndarray) -> Limits:
    return intervals(values, np.zeros(values.shape[1], dtype=np.intp), 0)


def student(values: np.ndarray) -> Limits:
    low, high = stats.t.interval(0.95, values.shape[1] - 1, values.mean(axis=1), stats.sem(values, axis=1))
    # Where nothing varies the interval is that one value.
    same = np.ptp(values, axis=1) == 0
    return np.where(same, values[:, 0], low), np.where(same, values[:, 0], high)


def scipys(method: str) -> Callable[[np.ndarray], Limits]:
    def limits(values: np.ndarray) -> Limits:
        rng, parts = np.random.default_rng(0), []
        for at in range(0, len(values), BATCH):
            part = values[at : at + BATCH]
            with np.errstate(all="ignore"):
                found = stats.bootstrap((part,), np.mean, axis=1, n_resamples=RESAMPLES, method=method, rng=rng)
            # BCa is undefined where nothing varies: counted as an interval of one value, as ours.
            same = np.ptp(part, axis=1) == 0
            interval = found.confidence_interval
            parts.append([np.where(same, part[:, 0], end) for end in (interval.low, interval.high)])
        low, high = (np.concatenate(ends) for ends in zip(*parts, strict=True))
        return low, high

    return limits


METHODS: Final[dict[str, Callable[[np.ndarray], Limits]]] = {
    "ours (studentised)": ours,
    "scipy BCa": scipys("BCa"),
    "scipy percentile": scipys("percentile"),
    "Student's t": student,
}


def main() -> None:
    print(f"| replicates, distribution | {' | '.join(METHODS)} |\n|---|{'---:|' * len(METHODS)}")
    took = dict.fromkeys(METHODS, 0.0)
    for replicates in (20, 10, 5):
        for kind, (draw, truth) in KINDS.items():
            values, cells = draw(np.random.default_rng(3), (SAMPLES, replicates)), []
            for name, method in METHODS.items():
                begun = time.process_time()
                low, high = method(values)
                took[name] += time.process_time() - begun
                # Equal values differ from their mean in the last bit.
                cells.append(f"{100 * np.mean((low - 1e-12 <= truth) & (truth <= high + 1e-12)):.0f}")
            print(f"| {replicates}, {kind} | {' | '.join(cells)} |", flush=True)
    print(
        f"| processor time in s, {SAMPLES} cells each | {' | '.join(f'{seconds:.1f}' for seconds in took.values())} |"
    )
    _tests()


def _tests() -> None:
    """What one sign-flip test costs."""
    gaps = np.random.default_rng(0).normal(0.3, 1, (20, PAIRS))
    begun = time.process_time()
    own = sign_flip_p(gaps)
    middle = time.process_time()
    theirs = stats.permutation_test(
        (gaps,), np.mean, permutation_type="samples", n_resamples=np.inf, axis=1, vectorized=True, batch=1000
    ).pvalue
    took = (middle - begun, time.process_time() - middle)
    print(
        f"\n20 exact sign-flip tests of {PAIRS} pairs: ours {took[0]:.2f} s, scipy's {took[1]:.2f} s; the largest "
        f"difference of their p: {np.abs(own - theirs).max():.1g}"
    )


if __name__ == "__main__":
    main()
