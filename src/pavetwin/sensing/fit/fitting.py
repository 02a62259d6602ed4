"""Fit the sensor `calibrated` to looks at defects.

The model is a probit regression with a normal random intercept per defect: P(yᵢ = 1 | u) = Φ(xᵢ · β + σ u), u standard
normal and the same for all looks at a defect. Its marginal likelihood integrates the product of a defect's looks over u
by the trapezoid rule, which converges fast for such smooth functions (Trefethen and Weideman 2014). Estimates are the
mode with weak normal priors on β and log σ, their covariance the inverse of the curvature there (Laplace).
`docs/decisions/0017-fitted-sensor.md` compares it with `BinomialBayesMixedGLM` of statsmodels.

The sensors do not import this module: they need neither SciPy nor polars.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, sqrt
from typing import Final

import numpy as np
import polars as pl
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp, ndtr, ndtri

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.errors import PaveTwinError
from pavetwin.sensing.fit.look_tables import CAPTURE, GROUP, LOOK_COLUMNS, LookSource
from pavetwin.sensing.fitted_sensor import (
    BEND,
    OF_ALL,
    OF_CLASS,
    FalseAlarms,
    FittedDetector,
    FittedNumber,
    FittedTo,
    SensorModel,
    Variable,
    bend,
    term_names,
    values_of,
)
from pavetwin.sensing.frame import Look
from pavetwin.sensing.sensor import PARAMETER_DRAWS

_REACH: Final = 6.0
_NODES: Final = 61
SD_OF_LOG_SPREAD: Final = 1.0
"""Standard deviation of the prior of log σ, whose median is σ = 1."""


@dataclass(frozen=True)
class MixedProbit:
    """Estimates of the regression."""

    beta: Float64Array
    """(terms,)"""
    log_spread: float
    """log σ"""
    covariance: Float64Array
    """(terms + 1, terms + 1) of β and log σ."""


def fit_mixed_probit(x: Float64Array, y: BoolArray, group: IndexArray, sd: Float64Array) -> MixedProbit:
    """Fit the model.

    Args:
        x: (looks, terms)
        y: (looks,)
        group: (looks,) number of the look's group.
        sd: (terms,) standard deviations of the priors of β.
    """
    order = np.argsort(group, kind="stable")
    problem = _Problem(x[order], np.where(y[order], 1.0, -1.0), np.flatnonzero(_begins(group[order])), sd)
    start = np.zeros(x.shape[1] + 1)
    found = minimize(problem.loss, start, jac=True, method="BFGS", options={"gtol": 1e-4 * max(1.0, len(y) ** 0.5)})
    mode: Float64Array = found.x
    covariance: Float64Array = np.asarray(np.linalg.inv(problem.curvature(mode)), dtype=np.float64)
    return MixedProbit(mode[:-1], float(mode[-1]), covariance)


def _begins(group: IndexArray) -> BoolArray:
    return np.concatenate([[True], group[1:] != group[:-1]])


@dataclass(frozen=True)
class _Problem:
    x: Float64Array
    sign: Float64Array
    first: IndexArray
    """(groups,) the first look of each; looks are sorted by group."""
    sd: Float64Array

    def loss(self, at: Float64Array) -> tuple[float, Float64Array]:
        """Minus the logarithm of the posterior, and its gradient."""
        beta, spread = at[:-1], np.exp(at[-1])
        nodes = np.linspace(-_REACH, _REACH, _NODES)
        weights = -0.5 * nodes**2 - logsumexp(-0.5 * nodes**2)
        z = self.sign[:, np.newaxis] * ((self.x @ beta)[:, np.newaxis] + spread * nodes)
        log_p = log_ndtr(z)
        joint = np.add.reduceat(log_p, self.first, axis=0) + weights
        of_group = logsumexp(joint, axis=1)
        sizes = np.diff(np.append(self.first, len(self.x)))
        share = np.repeat(np.exp(joint - of_group[:, np.newaxis]), sizes, axis=0)
        slope = share * self.sign[:, np.newaxis] * np.exp(-0.5 * z**2 - 0.5 * np.log(2 * np.pi) - log_p)
        gradient = np.append(self.x.T @ slope.sum(axis=1), spread * (slope @ nodes).sum())
        sd = np.append(self.sd, SD_OF_LOG_SPREAD)
        return float(0.5 * ((at / sd) ** 2).sum() - of_group.sum()), at / sd**2 - gradient

    def curvature(self, at: Float64Array, step: float = 1e-4) -> Float64Array:
        """Second derivatives of the loss, by differences of its gradient."""
        ahead = np.eye(len(at)) * step
        rows = [(self.loss(at + each)[1] - self.loss(at - each)[1]) / (2 * step) for each in ahead]
        found = np.array(rows)
        return np.asarray((found + found.T) / 2)


def found_by_draws(model: SensorModel, looks: Sequence[Sequence[Look]], count: int = PARAMETER_DRAWS) -> Float64Array:
    """(count, defects) the probability that at least one of a defect's looks finds it, in each draw.

    Args:
        looks: of each defect; none, or of a class that the model was not fitted to, find nothing.
    """
    draws = model.parameter_draws(count)
    columns = {name: at for at, name in enumerate(model.terms)}
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    effects = np.exp(draws[:, -1:, np.newaxis]) * nodes
    found = np.zeros((count, len(looks)))
    for at, mine in enumerate(looks):
        known = [model.row(look) for look in mine if look.kind in model.classes]
        if known:
            x = np.zeros((len(known), len(columns)))
            for row, values in enumerate(known):
                x[row, [columns[name] for name in values]] = list(values.values())
            scores = (draws[:, :-1] @ x.T)[:, :, np.newaxis]
            missed = np.exp(log_ndtr(-(scores + effects)).sum(axis=1))
            found[:, at] = 1.0 - missed @ (weights / weights.sum())
    return found


SD_OF_LEVEL, SD_OF_EFFECT, SD_OF_SHAPE, SD_OF_LIGHT = 2.5, 2.0, 1.0, 0.1
"""Standard deviations of the priors: of a class's level, and of an effect of a variable divided by its spread. A class
that was always found, or a variable that hardly varies, so gets a finite estimate with a wide error. Effects of the
size in pixels are near 2: a narrower prior flattens them. Those of the resolution and of the size's second term add to
them, and have narrower ones. Those of `LIGHT` are the same for a whole mission, so that few missions hold little
information on them: wide priors explain streets by their light and predict other streets worse."""

LIGHT: Final = ("off_centre", "blur", "sun", "clouds")

LEAST_BEND: Final = 0.5
"""Least distance of a spline's knots, log₂ of pixels: where a class's looks are all of one size."""

FEWEST: Final = 20
"""Least number of looks for about twenty parameters."""

FEWEST_ALARMS: Final = 10
"""Least number of false alarms for a dependence on the ground resolution."""


def fit_sensor(sources: Sequence[LookSource]) -> SensorModel:
    """Fit a sensor to the detections of one detector.

    Captures that several missions share, such as those of policies before they diverge, count once.

    Raises:
        PaveTwinError: the sources are of several detectors, or hold too few looks.
    """
    detector = _one_detector(sources)
    looks = pl.concat([each.looks for each in sources]).unique(maintain_order=True)
    images, alarms = _distinct(sources)
    found = looks["found"].to_numpy()
    if len(looks) < FEWEST or found.all() or not found.any():
        raise PaveTwinError(
            f"{len(looks)} looks, of which {int(found.sum())} found their defect, are too few to fit a sensor; give "
            "more missions or images."
        )
    variables, knots, x, terms = _design(looks)
    sd = np.array([SD_OF_LEVEL if name in knots else _sd_of_effect(name) for name in terms])
    groups, group = np.unique(looks[GROUP].to_list(), return_inverse=True)
    made = fit_mixed_probit(x, found, group, sd)
    errors = np.sqrt(np.diag(made.covariance))
    return SensorModel(
        detector=detector,
        fitted_to=FittedTo(
            looks=len(looks),
            found=int(found.sum()),
            defects=len(groups),
            repeated=int((np.bincount(group) > 1).sum()),
            images=len(images),
            area_m2=float(images["area_m2"].sum()),
            pixel_mm=(_smallest(images["pixel_mm"]), float(images["pixel_mm"].max())),  # type: ignore[arg-type]
            sources=tuple(each.name for each in sources),
        ),
        variables=variables,
        knots=knots,
        terms={name: _estimate(*pair) for name, *pair in zip(terms, made.beta, errors[:-1], strict=True)},
        log_spread=_estimate(made.log_spread, errors[-1]),
        covariance=tuple(tuple(float(f"{value:.4g}") for value in row) for row in made.covariance),
        false_alarms=_false_alarms(alarms, images),
    )


def _one_detector(sources: Sequence[LookSource]) -> FittedDetector:
    if not sources:
        raise PaveTwinError("Nothing to fit a sensor to; give folders of missions or of captures.")
    first, *others = sources
    for other in others:
        if other.detector.sha256 != first.detector.sha256 or other.detector.confidence != first.detector.confidence:
            raise PaveTwinError(
                f"'{first.name}' and '{other.name}' were searched by different detectors, or at a different "
                "confidence; a sensor is fitted to one."
            )
    return first.detector.model_copy(update={"image_px": max(each.detector.image_px for each in sources)})


def _smallest(values: pl.Series) -> float:
    return float(values.min())  # type: ignore[arg-type]


def _estimate(value: float, error: float) -> FittedNumber:
    return FittedNumber(estimate=float(f"{value:.6g}"), standard_error=float(f"{error:.4g}"))


def _sd_of_effect(term: str) -> float:
    if term in LIGHT:
        return SD_OF_LIGHT
    return SD_OF_SHAPE if term.rpartition(":")[2] in (BEND, "resolution") else SD_OF_EFFECT


def _knots(sizes: Float64Array) -> tuple[float, float, float]:
    """At the quantiles that Harrell proposes."""
    low, middle, high = (round(float(each), 4) for each in np.quantile(sizes, (0.1, 0.5, 0.9)))
    return min(low, middle - LEAST_BEND), middle, max(high, middle + LEAST_BEND)


def _design(
    looks: pl.DataFrame,
) -> tuple[dict[str, Variable], dict[str, tuple[float, float, float]], Float64Array, list[str]]:
    """The variables' centres and scales, the knots by class, x (looks, terms), and the terms' names."""
    rows = [values_of(Look(*row)) for row in looks.select(*LOOK_COLUMNS).iter_rows()]
    names = (*OF_CLASS, *OF_ALL)
    values = np.array([[row[name] for name in names] for row in rows], dtype=np.float64)
    centre, scale = np.nanmean(values, axis=0), np.nanstd(values, axis=0)
    scale = np.where(scale > 1e-6, scale, 1.0)
    scaled = np.nan_to_num((values - centre) / scale)
    kinds = sorted(looks["kind"].unique().to_list())
    columns, knots, size = [], {}, names.index("size")
    for kind in kinds:
        is_kind = (looks["kind"] == kind).to_numpy()
        here, sizes = is_kind.astype(np.float64), values[:, size]
        knots[kind] = _knots(sizes[is_kind])
        bent = np.array([bend(each, knots[kind]) for each in sizes]) / scale[size]
        columns += [here, *(here * scaled[:, at] for at in range(len(OF_CLASS))), here * bent]
    columns += [scaled[:, at] for at in range(len(OF_CLASS), len(names))]
    variables = {
        name: Variable(centre=float(f"{middle:.6g}"), scale=float(f"{width:.6g}"))
        for name, middle, width in zip(names, centre, scale, strict=True)
    }
    return variables, knots, np.column_stack(columns), term_names(kinds)


def _distinct(sources: Sequence[LookSource]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """The images of all sources, those of one capture once, and the false alarms in them, with the images' new rows."""
    numbered = [
        (each.images.with_row_index("image").with_columns(source=number), each.alarms.with_columns(source=number))
        for number, each in enumerate(sources)
    ]
    images = pl.concat([images for images, _ in numbered])
    images = images.filter(pl.col(CAPTURE).is_null() | pl.col(CAPTURE).is_first_distinct()).with_row_index("row")
    alarms = pl.concat([alarms for _, alarms in numbered]).with_columns(pl.col("image").cast(pl.UInt32))
    kept = alarms.join(images, on=["source", "image"], how="inner", maintain_order="left")
    return images, kept.select(pl.col("row").alias("image"), "kind", "size_px")


def _false_alarms(alarms: pl.DataFrame, images: pl.DataFrame) -> dict[str, FalseAlarms]:
    """Poisson regression of the images' counts on the logarithm of their ground resolution, by class."""
    found: dict[str, tuple[list[int], list[float]]] = {}
    for image, kind, size_px in alarms.iter_rows():
        at, sizes = found.setdefault(kind, ([], []))
        at.append(image)
        sizes.append(size_px)
    area_m2, steps = images["area_m2"].to_numpy(), np.log2(images["pixel_mm"].to_numpy())
    made = {}
    for kind, (at, sizes) in sorted(found.items()):
        counts = np.bincount(at, minlength=len(images)).astype(np.float64)
        level, slope = _rate(counts, area_m2, steps)
        made[kind] = FalseAlarms(level=level, slope=slope, size_px=float(np.median(sizes)))
    return made


def _rate(counts: Float64Array, area_m2: Float64Array, steps: Float64Array) -> tuple[FittedNumber, FittedNumber]:
    """Level and slope. Errors are those of a quasi-Poisson model: one thing that is not a defect is in many images."""
    varies = bool(np.ptp(steps) > 0.1 and counts.sum() >= FEWEST_ALARMS)
    if not varies:
        spread = sqrt(max(1.0, _dispersion(counts, area_m2 * counts.sum() / area_m2.sum(), 1)))
        return _estimate(log(counts.sum() / area_m2.sum()), spread / sqrt(counts.sum())), _estimate(0.0, 0.0)
    middle = float(steps.mean())
    x = np.column_stack([np.ones(len(steps)), steps - middle])

    def loss(at: Float64Array) -> tuple[float, Float64Array]:
        expected = area_m2 * np.exp(x @ at)
        return float(expected.sum() - counts @ (x @ at)), x.T @ (expected - counts)

    start = np.array([log(counts.sum() / area_m2.sum()), 0.0])
    found = minimize(loss, start, jac=True, method="BFGS").x
    expected = area_m2 * np.exp(x @ found)
    covariance = max(1.0, _dispersion(counts, expected, 2)) * np.linalg.inv(x.T @ (expected[:, np.newaxis] * x))
    errors = np.sqrt(np.diag(covariance))
    return _estimate(found[0] - found[1] * middle, errors[0]), _estimate(found[1], errors[1])


def _dispersion(counts: Float64Array, expected: Float64Array, parameters: int) -> float:
    """Pearson's χ² over the degrees of freedom."""
    return float(((counts - expected) ** 2 / expected).sum() / max(1, len(counts) - parameters))


@dataclass(frozen=True)
class ChanceBins:
    """Looks by the chance that a model gave them, in bins of as many looks each."""

    predicted: Float64Array
    """(bins,) mean chance."""
    observed: Float64Array
    """(bins,) share that found its defect."""
    standard_error: Float64Array
    """(bins,) Standard error of that share, clustered by defect."""
    looks: int


def chances_of(model: SensorModel, looks: pl.DataFrame) -> Float64Array:
    """(looks,) the chance of each."""
    return np.array([model.chance(Look(*row)) for row in looks.select(*LOOK_COLUMNS).iter_rows()])


def reliability(model: SensorModel, looks: pl.DataFrame, bins: int = 10) -> ChanceBins:
    """Observed shares of found defects against the chances of a model."""
    chance, found = chances_of(model, looks), looks["found"].to_numpy().astype(np.float64)
    groups = np.unique(looks[GROUP].to_list(), return_inverse=True)[1]
    parts = [part for part in np.array_split(np.argsort(chance, kind="stable"), bins) if len(part)]
    errors = []
    for part in parts:
        rest = found[part] - chance[part]
        together = np.bincount(groups[part], weights=rest)
        errors.append(sqrt(float((together**2).sum())) / len(part))
    return ChanceBins(
        predicted=np.array([chance[part].mean() for part in parts]),
        observed=np.array([found[part].mean() for part in parts]),
        standard_error=np.array(errors),
        looks=len(looks),
    )


@dataclass(frozen=True)
class RepeatedLooks:
    """Defects by how many of their looks found them, of those with one number of looks."""

    looks: int
    observed: Float64Array
    """(looks + 1,) defects found by 0, 1, … looks."""
    fitted: Float64Array
    """(looks + 1,) expected by the model."""
    independent: Float64Array
    """(looks + 1,) expected with the same chances, if each look were drawn by itself."""


def repeated_looks(model: SensorModel, looks: pl.DataFrame, count: int) -> RepeatedLooks:
    """Numbers of finding looks among `count` looks at each defect, evenly spread from its first to its last.

    Defects with fewer looks are left out.
    """
    chance, found = chances_of(model, looks), looks["found"].to_numpy()
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(looks[GROUP].to_list()):
        rows.setdefault(name, []).append(row)
    often = [np.array(mine) for mine in rows.values() if len(mine) >= count]
    spread = [mine[np.linspace(0, len(mine) - 1, count).round().astype(np.intp)] for mine in often]
    chosen = np.array(spread, dtype=np.intp).reshape(-1, count)
    counts = found[chosen].sum(axis=1)
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    level = ndtri(np.clip(chance[chosen], 1e-9, 1 - 1e-9)) * sqrt(1 + model.spread**2)
    given = ndtr(level[:, :, np.newaxis] + model.spread * nodes)
    shares = _counts_of(given).sum(axis=1) @ (weights / weights.sum())
    return RepeatedLooks(
        looks=count,
        observed=np.bincount(counts, minlength=count + 1).astype(np.float64),
        fitted=shares,
        independent=_counts_of(chance[chosen][:, :, np.newaxis]).sum(axis=(1, 2)),
    )


def _counts_of(chance: Float64Array) -> Float64Array:
    """(looks + 1, …) the probability of each number of hits, of (defects, looks, …) independent chances."""
    found = np.zeros((chance.shape[1] + 1, chance.shape[0], *chance.shape[2:]))
    found[0] = 1.0
    for look in range(chance.shape[1]):
        p = chance[:, look]
        found[1:] = found[1:] * (1 - p) + found[:-1] * p
        found[0] *= 1 - p
    return found
