"""Texture statistics that no training has touched, and how well they tell two sets of pictures apart.

Of the lightness of a picture: histograms of rotation-invariant uniform local binary patterns over 8 neighbours (Ojala,
Pietikäinen, Mäenpää 2002) at three scales, and the power of its spectrum by ring of spatial frequency, relative to the
whole, with how much it varies with the direction. A logistic regression with a quadratic penalty separates the sets;
what counts is its cross-validated area under the ROC curve (AUC): 0.5 cannot tell, 1 always can.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy.stats import rankdata

SIDE_PX: Final = 512
SCALES_PX: Final = (1, 2, 4)
RINGS: Final = 14
SECTORS: Final = 8
FOLDS: Final = 10
PENALTY: Final = 3.0
RESAMPLES: Final = 200

GROUPS: Final = {
    "all statistics": slice(None),
    "patterns at 1 pixel": slice(0, 10),
    "patterns at 2 pixels": slice(10, 20),
    "patterns at 4 pixels": slice(20, 30),
    "spectrum": slice(30, 30 + RINGS),
    "its spread over directions": slice(30 + RINGS, 30 + 2 * RINGS),
}
"""Columns of the statistics, by what they say."""

Float = npt.NDArray[np.float64]
Integers = npt.NDArray[np.intp]


def texture_statistics(picture: Image.Image) -> Float:
    """The statistics of one picture, brought to `SIDE_PX` unless it has that size."""
    grey = picture.convert("L")
    if grey.size != (SIDE_PX, SIDE_PX):
        grey = grey.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS)
    field = np.asarray(grey, dtype=np.float64)
    patterns = [
        _patterns(np.asarray(grey.reduce(scale), dtype=np.float64) if scale > 1 else field) for scale in SCALES_PX
    ]
    return np.concatenate([*patterns, *_spectrum(field)])


def _patterns(field: Float) -> Float:
    """Shares of the 10 rotation-invariant uniform patterns of 8 neighbours."""
    middle = field[1:-1, 1:-1]
    around = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
    rows, columns = field.shape
    above = np.stack([field[1 + dy : rows - 1 + dy, 1 + dx : columns - 1 + dx] >= middle for dy, dx in around])
    changes = (above != np.roll(above, 1, axis=0)).sum(axis=0)
    pattern = np.where(changes <= 2, above.sum(axis=0), 9)
    return np.bincount(pattern.ravel(), minlength=10) / pattern.size


def _spectrum(field: Float) -> Iterator[Float]:
    """By ring, its share of the power in decades, and the spread of that over directions."""
    window = np.hanning(SIDE_PX)
    power = np.abs(np.fft.rfft2((field - field.mean()) * window[:, None] * window)) ** 2
    fy, fx = np.fft.fftfreq(SIDE_PX)[:, None], np.fft.rfftfreq(SIDE_PX)
    frequency, angle = np.hypot(fx, fy), np.arctan2(fy, fx + 0 * fy)
    borders = np.geomspace(2 / SIDE_PX, 0.5, RINGS + 1)
    ring = np.digitize(frequency, borders) - 1
    sector = ((angle / np.pi + 0.5) * SECTORS).astype(int) % SECTORS
    inside = (ring >= 0) & (ring < RINGS)
    cell = ring[inside] * SECTORS + sector[inside]
    count = np.bincount(cell, minlength=RINGS * SECTORS).reshape(RINGS, SECTORS)
    total = np.bincount(cell, power[inside], RINGS * SECTORS).reshape(RINGS, SECTORS)
    mean = np.log10(total / np.maximum(count, 1) + 1e-6)
    level = np.log10(total.sum(axis=1) / count.sum(axis=1) + 1e-6)
    yield level - level.mean()
    yield np.where(count.min(axis=1) > 0, mean.std(axis=1), 0.0)


def told_apart(
    ours: Float, real: Float, *, scenes: Sequence[int] | None = None, resamples: int = RESAMPLES, seed: int = 0
) -> tuple[float, float, float]:
    """The AUC of a classifier that tells the rows of two tables apart, and its 95 % interval.

    The interval is that of a bootstrap over scenes, with the classifier fitted and cross-validated again on each
    resample, so that it holds the chance of training too. Photographs of one scene are drawn together and held out
    together, and so are the copies of a picture that is drawn several times: no picture is scored by a classifier that
    knows its place. A resample has fewer different pictures than there are, so its classifier tells less; the quantiles
    of the resampled AUC are therefore taken as deviations from their median.

    Args:
        ours, real: (n, k) statistics, a picture a row.
        scenes: number of the scene of each row of `real`; each row is one by itself unless given.
        resamples: of the bootstrap.
        seed: of the folds and of the resampling.
    """
    rng = np.random.default_rng(seed)
    real_scenes = np.arange(len(real)) if scenes is None else np.unique(scenes, return_inverse=True)[1]
    auc = _cross_validated(ours, np.arange(len(ours)), real, real_scenes, rng)
    drawn = []
    for _ in range(resamples):
        first = _resampled(np.arange(len(ours)), rng)
        second = _resampled(real_scenes, rng)
        drawn.append(_cross_validated(ours[first], first, real[second], real_scenes[second], rng))
    low, middle, high = np.quantile(drawn, (0.025, 0.5, 0.975))
    return auc, max(0.0, auc + float(low - middle)), min(1.0, auc + float(high - middle))


def _resampled(scenes: Integers, rng: np.random.Generator) -> Integers:
    """Rows of as many scenes as there are, drawn with replacement, all rows of each."""
    order = np.argsort(scenes, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(scenes))[:-1])
    return np.concatenate([parts[number] for number in rng.integers(len(parts), size=len(parts))])


def _cross_validated(
    ours: Float, our_scenes: Integers, real: Float, real_scenes: Integers, rng: np.random.Generator
) -> float:
    """The AUC of scores that each scene has from a classifier which was fitted without it."""
    table, is_real = np.concatenate([ours, real]), np.repeat([0.0, 1.0], [len(ours), len(real)])
    fold = np.concatenate([_folds(scenes, rng) for scenes in (our_scenes, real_scenes)])
    score = np.empty(len(table))
    for number in range(FOLDS):
        held = fold == number
        mean, spread = table[~held].mean(axis=0), table[~held].std(axis=0) + 1e-9
        weights = _fitted((table[~held] - mean) / spread, is_real[~held])
        score[held] = _with_one((table[held] - mean) / spread) @ weights
    return _auc(score[: len(ours)], score[len(ours) :])


def _folds(scenes: Integers, rng: np.random.Generator) -> Integers:
    """The fold of each row: whole scenes, about as many in each fold."""
    names, place = np.unique(scenes, return_inverse=True)
    return np.asarray(rng.permutation(np.arange(len(names)) % FOLDS)[place])


def _fitted(table: Float, label: Float) -> Float:
    """Weights of a logistic regression, the constant last and without a penalty, by Newton's method."""
    rows = _with_one(table)
    penalty = np.full(rows.shape[1], PENALTY)
    penalty[-1] = 1e-6
    weights = np.zeros(rows.shape[1])
    for _ in range(30):
        share = 1 / (1 + np.exp(-np.clip(rows @ weights, -30, 30)))
        slope = rows.T @ (share - label) + penalty * weights
        curve = (rows * (share * (1 - share) + 1e-9)[:, None]).T @ rows + np.diag(penalty)
        step = np.linalg.solve(curve, slope)
        weights = weights - step
        if np.abs(step).max() < 1e-8:
            break
    return weights


def _with_one(table: Float) -> Float:
    return np.column_stack([table, np.ones(len(table))])


def _auc(low: Sequence[float] | Float, high: Sequence[float] | Float) -> float:
    """The probability that one of `high` exceeds one of `low`."""
    ranks = rankdata(np.concatenate([low, high]))
    return float((ranks[len(low) :].sum() - len(high) * (len(high) + 1) / 2) / (len(low) * len(high)))
