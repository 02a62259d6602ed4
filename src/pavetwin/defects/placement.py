"""Placement of defects: each segment independently, with its own child seed.

On every segment `per_segment` defects are tried, or `per_100_m2` for its area; the class of each is drawn from the mix.
Each gets up to `SHAPES` shapes, and each shape up to `PLACES` poses from its class's sampler (wheel paths, joints,
edges, across). The first pose is taken where the whole outline lies on the segment's asphalt, 5 cm from its edge (or
from its concrete gutter) and 10 cm from every other defect. A defect is left out when there is no such pose, or when
the defects would cover more than `LARGEST_SHARE` of the segment: short segments may have fewer than requested.

Segments are processed in parallel on as many threads as there are cores: most of the work is done outside Python. The
result does not depend on the number of threads.
"""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Annotated, Any, Self

import numpy as np
import shapely
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator
from shapely import Point, Polygon

from pavetwin.arrays import Float64Array
from pavetwin.config.base import Settings
from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.measures import measure
from pavetwin.defects.poses import Poses, RoadSection
from pavetwin.defects.registry import DEFECT_CLASSES, DefectKind, failures_named, kinds, mixed
from pavetwin.defects.shapes import turned
from pavetwin.seeds import Stream, child
from pavetwin.world.build import Built
from pavetwin.world.content import snapped
from pavetwin.world.gutters import GUTTER_M, has_gutter
from pavetwin.world.model import Defect, Segment, Severity
from pavetwin.world.segments import direction_at, point_at, segment_key

SHAPES, PLACES = 3, 30
LARGEST_SHARE = 0.15
EDGE_M, APART_M = 0.05, 0.10

Placed = tuple[Point, float, Polygon]
"""Where a shape lies: its centre, its direction [rad], and its outline there."""


class DefectOptions(Settings):
    """How many defects of which classes a segment gets."""

    per_segment: Annotated[float, Field(ge=0, le=1000)] = 30.0
    """Rounded to a whole number."""
    per_100_m2: Annotated[float | None, Field(ge=0, le=100)] = None
    """Instead of `per_segment`: per 100 m² of the segment; rounded at random, so that it holds on average."""
    mix: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    """Class → weight; empty for each class's own weight; classes that are left out get none."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.mix and sum(self.mix.values()) <= 0:
            raise ValueError("the weights of the mix sum to 0")
        if self.per_100_m2 is not None and "per_segment" in self.model_fields_set:
            raise ValueError("give either per_segment or per_100_m2")
        return self

    @model_serializer(mode="wrap")
    def _as_given(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out `per_segment` when `per_100_m2` replaces it: both together are refused when read again."""
        values: dict[str, Any] = dump(self)
        if self.per_100_m2 is not None:
            values.pop("per_segment", None)
        return values

    def count_on(self, segment: Segment, rng: np.random.Generator) -> int:
        """How many defects to try on a segment."""
        if self.per_100_m2 is None:
            return round(self.per_segment)
        return math.floor(self.per_100_m2 * segment.area_m2 / 100 + float(rng.random()))


def add_defects(
    built: Built, options: DefectOptions | None = None, on_progress: Callable[[float], None] | None = None
) -> Built:
    """A built world with its defects, and a record of how they were placed; `on_progress` gets the share placed."""
    options = options or DefectOptions()
    if not options.mix and any(not DEFECT_CLASSES.is_own(kind.name) for kind in kinds()):
        # Written down, so that nobody who has not loaded the same plugins places something else.
        options = options.model_copy(update={"mix": {kind.name: kind.weight for kind in kinds()}})
    defects = place(built.world.segments, built.record.options.seed, options, on_progress)
    record = built.record.model_copy(update={"defects": options.model_dump(exclude_none=True)})
    return replace(built, world=replace(built.world, defects=defects), record=record)


def place(
    segments: Sequence[Segment],
    seed: int,
    options: DefectOptions | None = None,
    on_progress: Callable[[float], None] | None = None,
    threads: int | None = None,
) -> tuple[Defect, ...]:
    """The defects of all segments, numbered from 0 in order; on one thread per core, or as many as given.

    Raises:
        PaveTwinError: the mix names an unknown class.
    """
    options = options or DefectOptions()
    weighted = _weighted(options)
    defects: list[Defect] = []
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        found = pool.map(lambda segment: tuple(_on_segment(segment, seed, options, weighted)), segments)
        for done, own in enumerate(found, start=1):
            defects += [replace(defect, id=index) for index, defect in enumerate(own, start=len(defects))]
            if on_progress is not None:
                on_progress(done / len(segments))
    return tuple(defects)


def _weighted(options: DefectOptions) -> tuple[tuple[DefectKind, ...], Float64Array]:
    known = mixed(options.mix)
    weights = np.array([options.mix.get(kind.name, kind.weight) for kind in known])
    return known, weights / weights.sum()


def _on_segment(
    segment: Segment, seed: int, options: DefectOptions, weighted: tuple[tuple[DefectKind, ...], Float64Array]
) -> Iterator[Defect]:
    rng = child(seed, Stream.DEFECTS, segment_key(segment))
    allowed = segment.polygon.buffer(-EDGE_M - (GUTTER_M if has_gutter(segment.street) else 0.0))
    shapely.prepare(allowed)
    budget = LARGEST_SHARE * segment.area_m2
    road = RoadSection.of(segment)
    taken: list[Polygon] = []
    known, weights = weighted
    for _ in range(options.count_on(segment, rng)):
        kind = known[int(rng.choice(len(known), p=weights))]
        with failures_named(kind.name):
            for shape_seed in rng.integers(2**32, size=SHAPES).tolist():
                poses = kind.sample_poses(rng, road, PLACES)
                shape = kind.generate(np.random.default_rng(shape_seed))
                if shape.outline.area > budget:
                    continue
                placed = _first_place(segment, shape.outline, poses, allowed, taken)
                if placed is None:
                    continue
                taken.append(placed[2])
                budget -= placed[2].area
                defect = _defect(segment, kind, shape, shape_seed, placed)
                break
            else:
                continue
        yield defect


def _defect(segment: Segment, kind: DefectKind, shape: Heightfield, seed: int, placed: Placed) -> Defect:
    sizes = measure(shape)
    centre, yaw, polygon = placed
    return Defect(
        id=-1,
        segment=segment.id,
        kind=kind.name,
        centre=snapped(centre),
        polygon=snapped(polygon),
        seed=seed,
        yaw_rad=yaw,
        severity=Severity(kind.rate(sizes)),
        width_m=round(kind.width(sizes), 5),
        depth_m=round(sizes.depth_m, 5),
        length_m=round(kind.length(sizes), 3),
        volume_m3=round(sizes.volume_m3, 7),
    )


def _first_place(
    segment: Segment, outline: Polygon, poses: Poses, allowed: shapely.Geometry, taken: list[Polygon]
) -> Placed | None:
    ring = np.asarray(outline.exterior.coords)[:-1]
    others = np.array(taken)
    boxes = shapely.bounds(others) if taken else np.empty((0, 4))
    for along, offset, turn in poses.tolist():
        station = along * segment.length_m
        dx, dy = direction_at(segment.centre_line, station)
        base_x, base_y = point_at(segment.centre_line, station)
        x, y = base_x - dy * offset, base_y + dx * offset
        yaw = math.remainder(math.atan2(dy, dx) + turn, 2 * math.pi)
        corners = turned(ring, yaw) + np.array([x, y])
        polygon = Polygon(corners)
        if not shapely.contains_properly(allowed, polygon):
            continue
        low, high = corners.min(axis=0) - APART_M, corners.max(axis=0) + APART_M
        near = (boxes[:, :2] <= high).all(axis=1) & (boxes[:, 2:] >= low).all(axis=1)
        if near.any():
            shapely.prepare(polygon)
            if shapely.dwithin(polygon, others[near], APART_M).any():
                continue
        return Point(x, y), yaw, polygon
    return None
