"""Bootstrap intervals over images (Efron 1979): images of one group, which show one place, are drawn together.

Two recipes are compared on the same draws of images. Each has the detections of one training run or of several, with
other seeds; the runs of each are then drawn too, so that an interval has the spread between runs in it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.labels.class_names import ROAD_DEFECT
from pavetwin.training.evaluation.matching import HALF, Matched
from pavetwin.training.evaluation.scores import weighted_precision

SHARE: Final = 0.95  # Coverage of an interval, between symmetric quantiles

Metrics = Mapping[str, float]
"""Name → value, NaN where it is undefined."""


@dataclass(frozen=True, slots=True)
class ResampledInterval:
    """A value and its percentile interval; NaN where it is undefined."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ResampledDifference:
    """Difference in a metric: the second recipe's value minus the first's, each the mean over its runs."""

    value: float
    low: float
    high: float
    p: float
    """Twice the smaller share of draws on one side of 0, at most 1; ties, and the value itself, count on both sides."""


def metrics_of(five: Matched, coarse: Matched, confidence: float) -> Callable[[Float64Array], Metrics]:
    """The metrics of a detector as functions of how often each image is there."""

    def values(weights: Float64Array) -> Metrics:
        found: dict[str, float] = {}
        precision = [weighted_precision(each, weights) for each in five.classes]
        found["map50"] = _mean([float(each[HALF]) for each in precision])
        found["map50_95"] = _mean([float(each.mean()) for each in precision])
        half = slice(HALF, HALF + 1)
        found["coarse_map50"] = _mean([float(weighted_precision(each, weights, half)[0]) for each in coarse.classes])
        counts = np.array([_counts(five, at, weights, confidence) for at in range(len(five.classes))])
        there = counts[:, 0] > 0
        objects, hits, reported = counts[there].T
        found["precision"] = _mean(list(np.divide(hits, reported, out=np.zeros_like(hits), where=reported > 0)))
        found["recall"] = _mean(list(hits / objects))
        found["f1"] = _mean(list(2 * hits / (reported + objects)))
        for each, row in zip(five.classes, precision, strict=True):
            found[f"ap50 {each.name}"] = float(row[HALF])
        defects = coarse.classes[ROAD_DEFECT]
        found[f"ap50 {defects.name}"] = float(weighted_precision(defects, weights, half)[0])
        return found

    return values


def _counts(matched: Matched, at: int, weights: Float64Array, confidence: float) -> tuple[float, float, float]:
    """Objects, hits and detections that count of a class."""
    each = matched.classes[at]
    used = np.where((each.confidence >= confidence) & ~each.left_out[HALF], weights[each.image], 0.0)
    return float(weights[each.true_image].sum()), float(used[each.hit[HALF]].sum()), float(used.sum())


def _mean(values: list[float]) -> float:
    """Mean of the defined values."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")


def intervals(
    metrics: Callable[[Float64Array], Metrics], groups: tuple[str, ...], *, resamples: int, seed: int
) -> dict[str, ResampledInterval]:
    """Value and interval of each metric.

    Args:
        groups: of each image.
        resamples: 0 for values without intervals.
    """
    value = metrics(np.ones(len(groups)))
    drawn = [metrics(weights) for weights in _draws(groups, resamples, seed)]
    return {name: ResampledInterval(value[name], *_limits([each[name] for each in drawn])) for name in value}


Measures = Sequence[Callable[[Float64Array], Metrics]]
"""For each run of a recipe, metrics as a function of image weights."""


def differences(
    first: Measures, second: Measures, groups: tuple[str, ...], *, resamples: int, seed: int
) -> dict[str, ResampledDifference]:
    """Difference in each metric, second recipe minus first, on the same images.

    Args:
        first: one run or several; so `second`, whose runs need not be as many.
    """
    value = _apart(first, second, np.ones(len(groups)))
    drawn: dict[str, list[float]] = {name: [] for name in value}
    runs = np.random.default_rng((seed, 1))
    for weights in _draws(groups, resamples, seed):
        one, other = ([of[at] for at in runs.integers(len(of), size=len(of))] for of in (first, second))
        for name, value_drawn in _apart(one, other, weights).items():
            drawn[name].append(value_drawn)
    return {name: ResampledDifference(value[name], *_limits(row), _p(row)) for name, row in drawn.items()}


def _apart(first: Measures, second: Measures, weights: Float64Array) -> dict[str, float]:
    """Mean of the second less that of the first; NaN where a run has no value."""
    # A run that is drawn twice is measured once.
    known = {of: of(weights) for of in {*first, *second}}
    return {
        name: float(np.mean([known[of][name] for of in second]) - np.mean([known[of][name] for of in first]))
        for name in known[first[0]]
    }


def _draws(groups: tuple[str, ...], resamples: int, seed: int) -> list[Float64Array]:
    """How often each image is there, draw by draw."""
    names, place = np.unique(groups, return_inverse=True)
    rng = np.random.default_rng(seed)
    drawn = (rng.integers(len(names), size=len(names)) for _ in range(resamples))
    return [np.bincount(each, minlength=len(names))[place].astype(np.float64) for each in drawn]


def _limits(values: list[float]) -> tuple[float, float]:
    known = [value for value in values if not np.isnan(value)]
    if not known:
        return float("nan"), float("nan")
    low, high = np.quantile(known, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return float(low), float(high)


def _p(values: list[float]) -> float:
    known = np.array([value for value in values if not np.isnan(value)])
    if not len(known):
        return float("nan")
    fewer = min(int((known <= 0).sum()), int((known >= 0).sum()))
    return min(1.0, 2 * (1 + fewer) / (1 + len(known)))
