"""What a fitted sensor finds in draws of its parameters."""

from collections.abc import Sequence

import numpy as np
from scipy.special import log_ndtr

from pavetwin.arrays import Float64Array
from pavetwin.sensing.base import PARAMETER_DRAWS
from pavetwin.sensing.looks import Look
from pavetwin.sensing.sensor_model import SensorModel


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
