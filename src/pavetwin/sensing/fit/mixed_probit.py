"""Probit regression with a normal random intercept per group, by its marginal likelihood.

P(yᵢ = 1 | u) = Φ(xᵢ · β + σ u), u standard normal and the same within a group. The likelihood of a group is the
integral of the product of its looks over u, by the trapezoid rule, which converges fast for such smooth functions
(Trefethen and Weideman 2014). Estimates are the mode with weak normal priors on β and log σ, their covariance the
inverse of the curvature there (Laplace). Why not
`BinomialBayesMixedGLM` of statsmodels stands in docs/decisions/0017-fitted-sensor.md.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp

from pavetwin.arrays import BoolArray, Float64Array, IndexArray

_REACH: Final = 6.0
_NODES: Final = 61
SD_OF_LOG_SPREAD: Final = 1.0
"""Of the prior, whose median is σ = 1."""


@dataclass(frozen=True)
class MixedProbit:
    """What was fitted."""

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
