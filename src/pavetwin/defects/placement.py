"""Where defects lie: every segment by itself, from its own child of the seed.

On every segment `per_segment` defects are tried, whatever its size, the class of each drawn by the mix. Each gets up to
`SHAPES` outlines and for each up to `PLACES` places, evenly distributed over the carriageway, and takes the first where
its whole outline lies on the segment, 5 cm from its edge, and 10 cm from every other. It is left out when it finds
none, or when the defects would cover more than `LARGEST_SHARE` of the segment: short ones may have fewer than asked.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Annotated, Self

import numpy as np
import shapely
from pydantic import Field, model_validator
from shapely import Point, Polygon

from pavetwin.config.base import Settings
from pavetwin.defects.outlines import Points, turned
from pavetwin.defects.registry import DefectKind, kinds, unknown
from pavetwin.seeds import Stream, child
from pavetwin.world.build import Built
from pavetwin.world.content import snapped
from pavetwin.world.model import Defect, Segment
from pavetwin.world.segments import direction_at, segment_key

SHAPES, PLACES = 5, 30
LARGEST_SHARE = 0.15
EDGE_M, APART_M = 0.05, 0.10


class DefectOptions(Settings):
    """How many defects of which classes a segment gets."""

    per_segment: Annotated[float, Field(ge=0, le=1000)] = 30.0
    """Rounded to a whole number."""
    mix: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    """Class → weight; empty for every class's own weight, classes left out get none."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.mix and sum(self.mix.values()) <= 0:
            raise ValueError("the weights of the mix sum to 0")
        return self


def add_defects(built: Built, options: DefectOptions | None = None) -> Built:
    """A built world with its defects, and a note of how they were placed."""
    options = options or DefectOptions()
    defects = place(built.world.segments, built.record.options.seed, options)
    record = built.record.model_copy(update={"defects": options.model_dump()})
    return replace(built, world=replace(built.world, defects=defects), record=record)


def place(segments: Iterable[Segment], seed: int, options: DefectOptions | None = None) -> tuple[Defect, ...]:
    """The defects of all segments, numbered from 0 in their order.

    Raises:
        PaveTwinError: the mix names an unknown class.
    """
    options = options or DefectOptions()
    weighted = _weighted(options)
    defects: list[Defect] = []
    for segment in segments:
        for defect in _on_segment(segment, seed, round(options.per_segment), weighted):
            defects.append(replace(defect, id=len(defects)))
    return tuple(defects)


def _weighted(options: DefectOptions) -> tuple[tuple[DefectKind, ...], Points]:
    known = kinds()
    names = [kind.name.value for kind in known]
    for name in options.mix:
        if name not in names:
            raise unknown(name, names)
    weights = np.array([options.mix.get(kind.name.value, 0.0) if options.mix else kind.weight for kind in known])
    return known, weights / weights.sum()


def _on_segment(
    segment: Segment, seed: int, count: int, weighted: tuple[tuple[DefectKind, ...], Points]
) -> Iterator[Defect]:
    rng = child(seed, Stream.DEFECTS, segment_key(segment))
    room = segment.polygon.buffer(-EDGE_M)
    shapely.prepare(room)
    budget = LARGEST_SHARE * segment.area_m2
    taken: list[Polygon] = []
    known, weights = weighted
    for _ in range(count):
        kind = known[int(rng.choice(len(known), p=weights))]
        for shape_seed in rng.integers(2**32, size=SHAPES).tolist():
            shares = rng.random((PLACES, 2))
            outline = kind.outline(np.random.default_rng(shape_seed))
            placed = None if outline.area > budget else _first_place(segment, outline, shares, room, taken)
            if placed is not None:
                centre, polygon = placed
                taken.append(polygon)
                budget -= polygon.area
                yield Defect(-1, segment.id, kind.name, snapped(centre), snapped(polygon), shape_seed)
                break


def _first_place(
    segment: Segment, outline: Polygon, shares: Points, room: shapely.Geometry, taken: list[Polygon]
) -> tuple[Point, Polygon] | None:
    ring = np.asarray(outline.exterior.coords)[:-1]
    half = segment.width_m / 2 + 0.5
    for along, across in shares:
        station = float(along) * segment.length_m
        dx, dy = direction_at(segment.centre_line, station)
        base = segment.centre_line.interpolate(station)
        offset = (2 * float(across) - 1) * half
        x, y = base.x - dy * offset, base.y + dx * offset
        polygon = Polygon(turned(ring, math.atan2(dy, dx)) + np.array([x, y]))
        if shapely.contains(room, polygon) and not (
            taken and bool(shapely.dwithin(np.array(taken), polygon, APART_M).any())
        ):
            return Point(x, y), polygon
    return None
