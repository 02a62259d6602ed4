"""Streets with few defects, found with a chance that is known."""

import numpy as np

CASES = [(truth, alike) for truth in (0.6, 0.84, 0.95) for alike in (0.02, 0.1, 0.2)]
"""The chance that a defect is found, and the correlation between those of one street."""


def streets(rng: np.random.Generator, count: int, defects: int, truth: float, alike: float) -> tuple[np.ndarray, ...]:
    """(streets,) found and there: the chance varies from street to street so that defects of one are correlated."""
    there = rng.poisson(defects * rng.lognormal(-0.18, 0.6, count))
    a, b = truth * (1 - alike) / alike, (1 - truth) * (1 - alike) / alike
    return rng.binomial(there, rng.beta(a, b, count)), there
