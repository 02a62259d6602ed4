"""Why entries hold several defects: for each such entry, what the images show of its two largest.

Where one image reports both as one thing, no rule of merging can tell whose look that is; where by place all detections
lie on one defect, the mission's matching gave one of them to a neighbour.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

from shapely import Polygon

from pavetwin.inventory.observation import Observation

COVERED: Final = 0.3
"""Of each of two defects that one detection covers: it reports them as one."""


class Cause(StrEnum):
    """Why an entry holds two defects."""

    MATCHING = "by place it holds one: the matching gave a detection to a neighbour"
    ONE_OFTEN = "a third of its images or more report both as one"
    ONE_RARELY = "fewer of its images do, at least one"
    APART = "none of its images does"


class HoldsTwo(NamedTuple):
    """An entry that holds several defects."""

    kind: str
    cause: Cause
    away_m: float
    """Between the outlines of the two that most of its detections show; 0 where they overlap."""


def holding_two(
    observations: Sequence[Observation],
    groups: Sequence[Sequence[int]],
    judged: Mapping[str, Sequence[int | None]],
    outlines: Mapping[int, Polygon],
    around_m: float,
) -> Iterator[HoldsTwo]:
    """The entries that hold several defects by the matching or by place.

    Args:
        groups: of observations, one an entry.
        judged: by `matching` and `place`, the defect that each observation shows.
        outlines: of the defects that are there.
        around_m: outlines of observations are widened by this.
    """
    for group in groups:
        of = {
            name: Counter(number for at in group if (number := each[at]) is not None) for name, each in judged.items()
        }
        mine = max((of["place"], of["matching"]), key=len)
        if len(mine) < 2:
            continue
        first, second = (outlines[number] for number, _ in mine.most_common(2) if number is not None)
        images = {observations[at].image for at in group}
        as_one = {
            observations[at].image
            for at in group
            if _covers(observations[at], first, around_m) and _covers(observations[at], second, around_m)
        }
        if len(of["place"]) < 2:
            cause = Cause.MATCHING
        elif not as_one:
            cause = Cause.APART
        else:
            cause = Cause.ONE_OFTEN if 3 * len(as_one) >= len(images) else Cause.ONE_RARELY
        yield HoldsTwo(observations[group[0]].kind, cause, float(first.distance(second)))


def _covers(observation: Observation, outline: Polygon, around_m: float) -> bool:
    assert observation.footprint is not None
    return bool(observation.footprint.buffer(around_m).intersection(outline).area >= COVERED * outline.area)


def markdown(found: Sequence[HoldsTwo]) -> str:
    """How many entries there are of each cause, and how far apart the defects lie."""
    lines = [f"Entries that hold several defects: {len(found)}, {_classes(found)}.", "", "| cause | entries |"]
    lines += ["|---|---|", *(f"| {cause} | {sum(each.cause is cause for each in found)} |" for cause in Cause)]
    overlapping = sum(each.away_m == 0 for each in found)
    lines += ["", f"In {overlapping} of them the defects overlap in the world."]
    if found:
        far = [each.away_m for each in found]
        lines[-1] += f" They lie {min(far):.2f} to {max(far):.2f} m apart."
    return "\n".join(lines)


def _classes(found: Sequence[HoldsTwo]) -> str:
    counts = Counter(each.kind for each in found)
    return ", ".join(f"{count} of the class {kind}" for kind, count in counts.most_common()) or "none"
