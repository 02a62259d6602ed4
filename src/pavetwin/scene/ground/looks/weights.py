"""Choices by relative frequencies."""

from bisect import bisect
from collections.abc import Mapping
from itertools import accumulate
from typing import TypeVar

Chosen = TypeVar("Chosen")


def pick(weights: Mapping[Chosen, float], chance: float) -> Chosen:
    """One key of a table of weights, for a random number 0 … 1."""
    bounds = list(accumulate(weights.values()))
    return list(weights)[bisect(bounds, chance * bounds[-1], hi=len(bounds) - 1)]
