"""Answers of one look as classes and boxes, the most confident first."""

import numpy as np
from hypothesis import strategies as st

from pavetwin.arrays import Float32Array, Int64Array

Row = tuple[int, tuple[float, float, float, float]]
"""Number of the class; left, top, right, bottom in pixels."""


def arrays_of(rows: tuple[Row, ...]) -> tuple[Float32Array, Int64Array]:
    """(n, 4) boxes and (n,) classes."""
    boxes = np.array([box for _, box in rows], dtype=np.float32).reshape(-1, 4)
    return boxes, np.array([each for each, _ in rows], dtype=np.int64)


def rows(*classes: int) -> st.SearchStrategy[list[Row]]:
    """Up to twelve boxes of these classes that often overlap."""
    corner, sides = st.tuples(*[st.integers(0, 40)] * 2), st.tuples(*[st.integers(1, 40)] * 2)
    boxes = st.builds(lambda at, by: (*map(float, at), float(at[0] + by[0]), float(at[1] + by[1])), corner, sides)
    return st.lists(st.tuples(st.sampled_from(classes), boxes), max_size=12)
