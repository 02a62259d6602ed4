"""Numbers of copies of each image that give every class the same number of instances, although images show several
classes.

A copy adds all instances of its image, those of frequent classes too. So the numbers of copies are solved for together:
with c the instances of an image by class and s = c / Σc, copies x of images are sought with

    Σ x c = wanted − present for every class,   0 ≤ x ≤ most,   Σ (Σc) x² least:

every instance is copied as evenly as the classes allow. These are the calibration weights of survey sampling with
bounds (Deville and Särndal 1992, JASA 87, 376–382); by duality x = clip(λ·s, 0, most), with one multiplier λ a class
that is found by a convex minimisation. They are rounded by systematic sampling, and then copies are added or taken
away one by one while that helps, by what each copy really shows.

How many instances are wanted is found before, by linear programmes over all numbers of copies that are allowed: the
classes as equal as possible, and then as few copies as necessary. It is at least the number of the most frequent class,
and more where that class is in images of the rare ones. Images may also be left out (x = −1): as few as possible. In
the calibration leaving one out costs as much as `most` copies.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import optimize

from pavetwin.arrays import BoolArray, Float64Array, Int64Array

TOLERANCE: Final = 0.05
"""So far classes are equal: the fewest instances of a class, less than the most, as a share of the most."""

_STIFFNESS: Final = 1e-4  # Ridge on the multipliers: limits the pull of an unreachable class on the others
_TIE: Final = 1e-3  # Weight of the number of instances against kept images, over that of the most frequent class
_NEARER: Final = 1e-2  # Weight of a class against kept images, by its distance to the most frequent class

_EQUAL: Final = (1.0, 0.98, 0.96)
"""Equal enough: the share that the rarest class has of the most frequent; what is more equal may take many copies."""

_AS_EQUAL: Final = 0.005  # Accuracy of the greatest equality if none of these is feasible
_RARELY_MORE: Final = 1e-6  # Tie-breaker: of two equal gains, the image with fewer copies changes


@dataclass(frozen=True, slots=True)
class CopyPlan:
    """The copies of every image."""

    copies: Int64Array
    """(images,) number of copies besides the image itself; −1 where the image is left out."""
    target: int
    """Instances that every class should have."""
    present: Int64Array
    """(classes,) instances of the images."""
    reached: Int64Array
    """(classes,) instances of the images that are kept and of all copies."""
    can_reach: Int64Array
    """(classes,) instances at most: every image that shows the class copied as often as allowed."""

    @property
    def spread(self) -> float:
        """Relative gap from the rarest to the most frequent class, over classes with any instance."""
        held = self.reached[self.present > 0]
        return 1 - float(held.min() / held.max()) if held.size else 0.0


CopyCounts = Callable[[int, int], Int64Array]
"""Function of an image and the number of its copy, from 0: instances (classes,) in that copy."""


def plan_copies(
    counts: Int64Array,
    most: int,
    counts_of_copy: CopyCounts,
    *,
    target: int | None = None,
    leave_out: bool = False,
    offset: float = 0.5,
) -> CopyPlan:
    """Numbers of copies that give every class the same number of instances, as closely as possible.

    Args:
        counts: (images, classes) instances.
        most: copies of one image.
        target: instances of each class: at least, or exactly where images may be left out.
        leave_out: whether images may be.
        offset: of the systematic sampling that rounds, 0 … 1.
    """
    present = counts.sum(axis=0)
    is_there = present > 0
    shows = counts[:, is_there].astype(np.float64)
    kept = _kept_shares(counts, counts_of_copy)[is_there]
    held = present[is_there].astype(np.float64)
    wanted = _wanted(shows, kept, held, most, target=target, leave_out=leave_out)
    copies = _rounded(_calibrated(shows, (wanted - held) / kept, most, leave_out=leave_out), offset)
    state = _State(counts, copies, most, counts_of_copy, _expand(wanted, is_there), _expand(kept, is_there), leave_out)
    state.improve()
    reach = present + np.rint(most * _expand(kept * held, is_there)).astype(np.int64)
    return CopyPlan(state.copies, round(wanted.max(initial=0.0)), present, state.totals.astype(np.int64), reach)


def _kept_shares(counts: Int64Array, counts_of_copy: CopyCounts) -> Float64Array:
    """(classes,) The share of instances that a copy keeps: rotation cuts some off. From the first copy of each."""
    shown = np.zeros(counts.shape[1])
    for image in np.flatnonzero(counts.sum(axis=1)).tolist():
        shown += counts_of_copy(image, 0)
    # A class that no first copy shows can still be in others.
    kept: Float64Array = np.maximum(shown, 1.0) / np.maximum(counts.sum(axis=0), 1.0)
    return kept


def _wanted(
    shows: Float64Array, kept: Float64Array, held: Float64Array, most: int, *, target: int | None, leave_out: bool
) -> Float64Array:
    """(classes,) The instances to aim at: equal, or as nearly as can be."""
    if not len(held):
        return held
    kinds, number = np.unique(shows, axis=0, return_counts=True)
    some, classes = kinds.shape
    # Variables: images kept of each kind, copies of them, and the instances of the class that has most.
    gains = np.column_stack([kinds.T, (kinds * kept).T, np.zeros(classes)])
    per_image = np.column_stack([-most * np.eye(some), np.eye(some), np.zeros(some)])
    sign = -1.0 if leave_out else 1.0
    objective = np.concatenate([-np.ones(some), np.zeros(some), [sign * _TIE / held.max()]])
    most_frequent = float(held.max())
    above = (max(float(target or 0), most_frequent), None)
    allowed = (float(target or 1), float(target or most_frequent)) if leave_out else above
    bounds = [
        *((0.0 if leave_out else float(each), float(each)) for each in number),
        *((0.0, float(most * each)) for each in number),
        allowed,
    ]
    last = np.eye(gains.shape[1])[-1]

    def solved(equality: float) -> Float64Array | None:
        """The instances by class where the rarest has at least this share of the most frequent; None if none can."""
        rows = np.vstack([per_image, gains - last, equality * last - gains])
        given: dict[str, Any] = {"A_ub": rows, "b_ub": np.zeros(len(rows)), "method": "highs"}
        found = optimize.linprog(objective, bounds=bounds, **given)
        if found.status != 0:
            return None
        # Only what holds the rarest class back shall; the others come as near to the most frequent as they can.
        fixed = [*bounds[:-1], (found.x[-1], found.x[-1])]
        nearer = optimize.linprog(objective - _NEARER / held.max() * gains.sum(axis=0), bounds=fixed, **given)
        best: Float64Array = gains @ (nearer.x if nearer.status == 0 else found.x)
        return best

    for equality in _EQUAL:
        if (best := solved(equality)) is not None:
            return best
    # One that asks for no equality has a solution.
    best, possible, too_much = solved(0.0), 0.0, min(_EQUAL)
    while too_much - possible > _AS_EQUAL:
        middle = (possible + too_much) / 2
        if (found := solved(middle)) is not None:
            best, possible = found, middle
        else:
            too_much = middle
    assert best is not None
    return best


def _calibrated(shows: Float64Array, missing: Float64Array, most: int, *, leave_out: bool) -> Float64Array:
    """(images,) Copies, not whole yet, by which the classes gain what they miss; see the top of this file."""
    size = shows.sum(axis=1)
    shares = shows / np.maximum(size, 1.0)[:, None]
    least = -1.0 if leave_out else 0.0
    dear = float(max(most, 1)) ** 2
    scale = max(float(np.abs(missing).max(initial=0.0)), 1.0)

    def dual(multipliers: Float64Array) -> tuple[float, Float64Array]:
        unbounded = shares @ multipliers
        copies = np.clip(np.where(unbounded < 0, unbounded / dear, unbounded), least, float(most))
        cost = np.where(copies < 0, dear, 1.0) * copies**2 / 2
        value = (size * (unbounded * copies - cost)).sum() - multipliers @ missing
        ridge = _STIFFNESS * scale / 2 * (multipliers @ multipliers)
        slope = shows.T @ copies - missing + _STIFFNESS * scale * multipliers
        return float(value + ridge) / scale, slope / scale

    if not shows.size:
        return np.zeros(len(shows))
    found = optimize.minimize(dual, np.zeros(shows.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 2000})
    unbounded = shares @ found.x
    copies: Float64Array = np.clip(np.where(unbounded < 0, unbounded / dear, unbounded), least, float(most))
    return copies


def _rounded(copies: Float64Array, offset: float) -> Int64Array:
    """Whole numbers with the same sum to within one, each within one of its own (systematic sampling)."""
    ends = np.floor(np.cumsum(copies) + offset)
    return np.diff(ends, prepend=np.floor(offset)).astype(np.int64)


def _expand(values: Float64Array, is_there: BoolArray) -> Float64Array:
    whole = np.zeros(len(is_there))
    whole[is_there] = values
    return whole


class _State:
    """Numbers of copies, improved one by one by what the copies really show."""

    def __init__(
        self,
        counts: Int64Array,
        copies: Int64Array,
        most: int,
        counts_of_copy: CopyCounts,
        wanted: Float64Array,
        kept: Float64Array,
        leave_out: bool,
    ) -> None:
        self._counts, self._most, self._of_copy, self._wanted = counts, most, counts_of_copy, wanted
        self._least = -1 if leave_out else 0
        self.copies = np.clip(copies, self._least, most)
        self._gains = counts * kept
        """(images, classes) What one more copy is expected to show."""
        self._losses = np.zeros(counts.shape)
        """(images, classes) What is lost with the last copy."""
        self.totals = np.zeros(counts.shape[1])
        for image, number in enumerate(self.copies.tolist()):
            self.totals += counts[image] if number >= 0 else 0
            for copy in range(number):
                self.totals += counts_of_copy(image, copy)
            self._know(image)

    def _know(self, image: int) -> None:
        number = int(self.copies[image])
        self._losses[image] = self._counts[image] if number == 0 else 0
        if number > 0:
            self._losses[image] = self._of_copy(image, number - 1)

    def improve(self) -> None:
        """Add or take away one copy at a time while the squared distances of the classes to the target fall."""
        blocked = np.zeros(len(self.copies), dtype=np.bool_)
        while True:
            away = self.totals - self._wanted
            adding = (self._gains * (2 * away + self._gains)).sum(axis=1) + _RARELY_MORE * self.copies
            taking = (self._losses * (self._losses - 2 * away)).sum(axis=1) - _RARELY_MORE * self.copies
            adding[blocked | (self.copies >= self._most)] = np.inf
            taking[self.copies <= self._least] = np.inf
            add, take = int(adding.argmin()), int(taking.argmin())
            if min(adding[add], taking[take]) >= -0.5:
                return
            if taking[take] <= adding[add]:
                self._change(take, -1)
            elif not self._try_to_add(add, away):
                blocked[add] = True

    def _try_to_add(self, image: int, away: Float64Array) -> bool:
        number = int(self.copies[image])
        gain = self._counts[image] if number < 0 else self._of_copy(image, number)
        if (gain * (2 * away + gain)).sum() >= -0.5:
            return False
        self._change(image, 1)
        return True

    def _change(self, image: int, by: int) -> None:
        if by < 0:
            self.totals -= self._losses[image]
        else:
            number = int(self.copies[image])
            self.totals += self._counts[image] if number < 0 else self._of_copy(image, number)
        self.copies[image] += by
        self._know(image)
