"""Another processor's floating point: what NumPy computes by vector instructions, off by a unit in the last place.

NumPy takes these functions from a library of its own where a processor has AVX-512, and from the system's elsewhere;
their results differ by a unit in the last place for some arguments. Sums, products and square roots are the same.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

VECTORISED = (
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "cbrt"),
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh"),
)


def move_last_digits(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Half of all results of these functions are the next number up or down, the same for the same result.

    Returns:
        How many results were moved so far.
    """
    moved = [0]

    def off_by_one(function: Callable[..., Any]) -> Callable[..., Any]:
        def computed(*arguments: Any, **options: Any) -> Any:
            exact = function(*arguments, **options)
            values = np.asarray(exact)
            if not np.issubdtype(values.dtype, np.floating):
                return exact
            bits = np.ascontiguousarray(values).view(f"i{values.dtype.itemsize}").reshape(values.shape).astype(np.int64)
            draw = (bits * np.int64(-7046029254386353131)) >> 62
            target = np.where(draw == 1, np.inf, np.where(draw == -1, -np.inf, values)).astype(values.dtype)
            off = np.where(np.isin(values, (0.0, 1.0, -1.0)), values, np.nextafter(values, target))
            moved[0] += int((off != values).sum())
            if isinstance(exact, np.ndarray):
                exact[...] = off
                return exact
            return off[()]

        return computed

    for name in VECTORISED:
        monkeypatch.setattr(np, name, off_by_one(getattr(np, name)))
    return lambda: moved[0]
