"""Placement of defects: each segment independently, with its own child seed.

A damage population gives the number of defects of each class to try on a segment. Each gets up to `SHAPES` shapes, and
each shape up to `PLACES` poses (wheel paths, joints, edges, across; near others). The first pose is taken where the
whole outline lies on the segment's asphalt, 5 cm from its edge (or from its concrete gutter) and 10 cm from every other
defect. A defect is left out when there is no such pose, or when the defects would cover more than `LARGEST_SHARE` of
the segment: short segments may have fewer than requested.

Segments are processed in parallel, by processes where these have been started, else on threads. The result does not
depend on their number.

Placed defects are kept in the cache between runs, and `build_folder` writes a world with its defects.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Final, Self

import numpy as np
import shapely
from pydantic import Field, model_validator
from shapely import Point, Polygon

from pavetwin.config.settings import NameOrFile, Settings
from pavetwin.defects.context import Feature, poses_at, room_for
from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.measures import measure
from pavetwin.defects.population import ClassPopulation, DefectDensity, Population, Shares, population
from pavetwin.defects.poses import Poses, RoadSection
from pavetwin.defects.registry import DEFECT_CLASSES, DefectKind, failures_named, heightfield_of, kinds, mixed
from pavetwin.defects.shapes import Host, Notched, places_in, turned
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.workers import OnTick, WaitingProcess, WorkerPool, cores, may_start, started
from pavetwin.world.build import BuildOptions, BuildRecord, Built, build_world
from pavetwin.world.cache import ValueStore, cache_folder, made_by, short_sha256
from pavetwin.world.content import snapped
from pavetwin.world.folder import check_target
from pavetwin.world.generate import NetworkKind
from pavetwin.world.model import Defect, Segment, Severity, ShapeParameters, World
from pavetwin.world.pavement_joints import GUTTER_M, has_gutter
from pavetwin.world.segments import direction_at, point_at, segment_key
from pavetwin.world.store import save_world

PLACED: Final = "placed by the program, not surveyed"
"""Origin of the defects of a world, for tables."""

SHAPES, PLACES = 3, 30
LARGEST_SHARE = 0.15
EDGE_M, APART_M = 0.05, 0.10

HOSTS, PLACES_WITHIN = 3, 12
"""The largest defects within which one is tried to lie, and the places tried in each."""

WITHIN = 4
"""Key of the random numbers under the seed of a shape for its places within another."""

Placed = tuple[Point, float, Polygon]
"""A shape's centre, its direction [rad], and its outline there."""


class DefectOptions(Settings):
    """Kinds and number of the defects of a world."""

    population: NameOrFile = "survey"
    """A damage population by name (`survey`, `paper`), or a YAML file of the same form: numbers, classes, sizes and
    positions. The other options replace parts of it."""
    per_segment: Annotated[float | None, Field(ge=0, le=1000)] = None
    """Equal number on every segment, rounded to a whole number."""
    per_100_m2: Annotated[float | None, Field(ge=0, le=100)] = None
    """Mean number per 100 m² of the segments; streets and segments vary as in the population."""
    mix: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    """Class → weight; empty for the population's; classes that are left out get none."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.mix and sum(self.mix.values()) <= 0:
            raise ValueError("the weights of the mix sum to 0")
        if self.per_100_m2 is not None and self.per_segment is not None:
            raise ValueError("give either per_segment or per_100_m2")
        return self

    @classmethod
    def of_record(cls, record: BuildRecord) -> Self:
        """Options by which the defects of a world were placed; the defaults where there are none.

        Raises:
            PaveTwinError: the record does not fit.
        """
        return cls.parse(record.defects, where="world.yaml: defects") if record.defects else cls()

    def density(self) -> DefectDensity:
        """Density of defects: the population's, or its replacement.

        Raises:
            PaveTwinError: there is no such population.
        """
        own = population(self.population).density
        if self.per_segment is not None:
            return DefectDensity(per_segment=self.per_segment)
        if self.per_100_m2 is not None:
            return own.model_copy(update={"per_100_m2": self.per_100_m2, "per_segment": None})
        return own

    def effective(self) -> Population:
        """The population with the parts replaced that these options give.

        Raises:
            PaveTwinError: there is no such population, or it or the mix names an unknown class.
        """
        found = population(self.population)
        changes: dict[str, Any] = {"density": self.density()}
        if self.mix:
            mixed(self.mix)
            listed = [name for name in found.classes if name in self.mix]
            changes["classes"] = {
                name: found.of_class(name).model_copy(update={"weight": self.mix[name]})
                for name in [*listed, *sorted(self.mix.keys() - set(listed))]
            }
        elif found.classes:
            total = sum(each.weight for each in found.classes.values())
            own = [kind for kind in kinds() if not kind.ships and kind.name not in found.classes]
            more = {kind.name: ClassPopulation(weight=kind.weight * total) for kind in own}
            changes["classes"] = {**found.classes, **more}
        return found.model_copy(update=changes)


def add_defects(
    built: Built,
    options: DefectOptions | None = None,
    on_progress: Callable[[float], None] | None = None,
    waiting: Sequence[WaitingProcess] = (),
) -> Built:
    """A built world with its defects, and a record of how they were placed; `on_progress` gets the share placed, and
    `waiting` is as in `place`."""
    options = options or DefectOptions()
    if not options.mix and any(not kind.ships for kind in kinds()):
        # Recorded, so that placement does not depend on the plugins that a later reader has loaded.
        weights = {kind.name: share for kind, share in options.effective().shares()}
        options = options.model_copy(update={"mix": weights})
    defects = place(built.world.segments, built.record.options.seed, options, on_progress, waiting=waiting)
    record = built.record.model_copy(update={"defects": options.model_dump(exclude_none=True)})
    return replace(built, world=replace(built.world, defects=defects), record=record)


def place(
    segments: Sequence[Segment],
    seed: int,
    options: DefectOptions | None = None,
    on_progress: Callable[[float], None] | None = None,
    threads: int | None = None,
    waiting: Sequence[WaitingProcess] = (),
) -> tuple[Defect, ...]:
    """The defects of all segments, numbered from 0 in order; on one thread per core, or as many as given.

    Args:
        waiting: processes that place defects in place of threads, which get in each other's way. They do not know
            classes of the user's own.

    Raises:
        PaveTwinError: the mix names an unknown class.
    """
    whole = options or DefectOptions()
    shares = whole.effective().shares()
    placed: list[list[Defect]] = [[] for _ in segments]
    done = 0

    def on_placed(number: int, found: list[Defect]) -> None:
        nonlocal done
        placed[number], done = found, done + 1
        if on_progress is not None:
            on_progress(done / len(segments))

    if waiting and all(kind.ships for kind, _ in shares):
        with WorkerPool(len(waiting), partial(_placing, whole, seed), waiting=waiting) as processes:
            processes.run(enumerate(segments), lambda task, found: on_placed(task[0], found), give_up=_give_up)
    else:
        with ThreadPoolExecutor(threads or cores()) as pool:
            for number, found in enumerate(pool.map(_on_segment(whole, seed), segments)):
                on_placed(number, found)
    return tuple(replace(defect, id=number) for number, defect in enumerate(chain.from_iterable(placed)))


def _on_segment(options: DefectOptions, seed: int) -> Callable[[Segment], list[Defect]]:
    """Function that gives the defects of a segment."""
    whole = options.effective()
    shares = whole.shares()
    return lambda segment: SegmentPlacement(segment, seed, whole, shares).defects()


def _placing(options: DefectOptions, seed: int, _on_tick: OnTick) -> Callable[[tuple[int, Segment]], list[Defect]]:
    """Place the defects of a segment and its number in a separate process."""
    on_segment = _on_segment(options, seed)
    return lambda task: on_segment(task[1])


def _give_up(task: tuple[int, Segment]) -> None:
    raise PaveTwinError(
        f"Processes that placed defects on segment {task[1].id} died several times, perhaps for lack of memory."
    )


class SegmentPlacement:
    """The defects of one segment."""

    def __init__(self, segment: Segment, seed: int, population: Population, shares: Shares) -> None:
        self.segment, self.population, self.shares, self.seed = segment, population, shares, seed
        self._rng = child(seed, Stream.DEFECTS, segment_key(segment))
        self._road = RoadSection.of(segment)
        self._allowed = segment.polygon.buffer(-EDGE_M - (GUTTER_M if has_gutter(segment.street) else 0.0))
        shapely.prepare(self._allowed)
        self._budget = LARGEST_SHARE * segment.area_m2
        self._taken: list[Polygon] = []
        self._found: list[Defect] = []
        self._outline_at: list[int] = []
        """Index in `_taken` of the outline of each defect found."""
        self._poses: dict[str, list[tuple[float, float]]] = {}
        self._worn = cache(lambda name: population.worn(name, segment, seed))

    def defects(self) -> list[Defect]:
        """Defects in the order of their placement, as many as find a place."""
        for drawn in self.population.kinds_on(self.segment, self.shares, self.seed, self._rng):
            kind = self.population.kind_on(self.segment.street, drawn)
            with failures_named(kind.name):
                defect = self._placed(kind)
            if defect is not None:
                self._found.append(defect)
        return self._found

    def _placed(self, kind: DefectKind) -> Defect | None:
        """A defect of a class, or None where no shape finds a place."""
        of_class = self.population.of_class(kind.name)
        worn = self._worn(kind.name)
        for shape_seed in self._rng.integers(2**32, size=SHAPES).tolist():
            parameters = of_class.parameters(self._rng, worn)
            poses = self._near_others(of_class, of_class.poses(self._rng, kind, self._road, PLACES))
            beside = None
            if of_class.context is not None:
                beside, more = of_class.context.draw(shape_seed, self.segment.street)
                parameters += more
            shape = kind.shape(shape_seed, parameters)
            if beside is not None:
                low_x, _, high_x, _ = shape.outline.bounds
                poses = poses_at(shape_seed, beside, self.segment, PLACES, high_x - low_x)
            if shape.outline.area > self._budget:
                continue
            if (host := of_class.host(shape_seed)) and (within := self._within(host, shape.outline, shape_seed)):
                self._take(within[2])
                return _defect(self.segment, kind, shape, shape_seed, parameters, within)
            placed = self._first_place(shape.outline, poses, beside)
            if placed is None:
                continue
            centre, yaw, polygon, pose = placed
            self._take(polygon)
            self._poses.setdefault(kind.name, []).append(pose)
            made = _defect(self.segment, kind, shape, shape_seed, parameters, (centre, yaw, polygon))
            if beside is None:
                return made
            if (room := room_for(beside, polygon, yaw)) is not None:
                self._taken.append(room)
            return replace(made, beside=beside.value)
        return None

    def _take(self, polygon: Polygon) -> None:
        """Keep the outline of a defect free of others."""
        self._outline_at.append(len(self._taken))
        self._taken.append(polygon)
        self._budget -= polygon.area

    def _within(self, host: str, outline: Polygon, seed: int) -> Placed | None:
        """Place of an outline within a defect of a class, which loses the part there; None where it fits in none."""
        rng = child(seed, Stream.DEFECTS, WITHIN)
        found = [number for number, defect in enumerate(self._found) if defect.kind == host and not defect.notch]
        found.sort(key=lambda number: -self._found[number].polygon.area)
        low_x, low_y, high_x, high_y = outline.bounds
        length = max(high_x - low_x, high_y - low_y)
        ring = np.asarray(outline.exterior.coords)[:-1]
        for number in found[:HOSTS]:
            defect, at = self._found[number], self._outline_at[number]
            whole = Host(heightfield_of(defect), defect.centre, defect.yaw_rad)
            others = np.array([*self._taken[:at], *self._taken[at + 1 :]])
            for x, y in places_in(whole, length, rng, PLACES_WITHIN):
                yaw = float(rng.uniform(-math.pi, math.pi))
                polygon = Polygon(turned(ring, yaw) + (x, y))
                if not shapely.contains_properly(self._allowed, polygon):
                    continue
                if shapely.dwithin(others, polygon, APART_M).any():
                    continue
                left = whole.notched(polygon, APART_M)
                if left is None:
                    continue
                self._notch(number, left)
                return Point(x, y), yaw, polygon
        return None

    def _notch(self, number: int, left: Notched) -> None:
        """Remove the notch from a placed defect."""
        before, at = self._found[number], self._outline_at[number]
        outline = turned(np.asarray(left.shape.outline.exterior.coords)[:-1], before.yaw_rad)
        polygon = Polygon(outline + np.array(before.centre.coords[0]))
        placed = before.centre, before.yaw_rad, polygon
        kind = DEFECT_CLASSES.get(before.kind)
        made = _defect(self.segment, kind, left.shape, before.seed, before.parameters, placed)
        self._found[number] = replace(made, notch=left.ring, beside=before.beside)
        self._taken[at] = polygon
        self._budget += before.polygon.area - polygon.area

    def _near_others(self, of_class: ClassPopulation, poses: Poses) -> Poses:
        """The poses, moved near a defect of another class where the population requires it."""
        if not of_class.near:
            return poses
        neighbour = of_class.neighbour(self._rng)
        there = self._poses.get(neighbour[0], []) if neighbour else []
        if neighbour is None or not there:
            return poses
        near = neighbour[1]
        along, offset = there[int(self._rng.integers(len(there)))]
        moved = poses.copy()
        station = along * self._road.length_m + self._rng.normal(0.0, near.along_m, len(poses))
        moved[:, 0] = np.clip(station / self._road.length_m, 0.0, 1.0)
        if near.across_m is None:
            return moved
        moved[:, 1] = offset + self._rng.normal(0.0, near.across_m, len(poses))
        away = np.hypot(moved[:, 0] * self._road.length_m - along * self._road.length_m, moved[:, 1] - offset)
        return np.asarray(moved[np.argsort(away, kind="stable")])

    def _first_place(
        self, outline: Polygon, poses: Poses, beside: Feature | None
    ) -> tuple[Point, float, Polygon, tuple[float, float]] | None:
        """The first pose at which an outline, and what it starts at, lie on the asphalt and clear of others: centre,
        direction, outline."""
        line = self.segment.centre_line
        ring = np.asarray(outline.exterior.coords)[:-1]
        others = np.array(self._taken)
        boxes = shapely.bounds(others) if self._taken else np.empty((0, 4))
        for along, offset, turn in poses.tolist():
            station = along * self.segment.length_m
            dx, dy = direction_at(line, station)
            base_x, base_y = point_at(line, station)
            x, y = base_x - dy * offset, base_y + dx * offset
            yaw = math.remainder(math.atan2(dy, dx) + turn, 2 * math.pi)
            corners = turned(ring, yaw) + np.array([x, y])
            polygon = Polygon(corners)
            if not shapely.contains_properly(self._allowed, polygon):
                continue
            low, high = corners.min(axis=0) - APART_M, corners.max(axis=0) + APART_M
            near = (boxes[:, :2] <= high).all(axis=1) & (boxes[:, 2:] >= low).all(axis=1)
            if near.any():
                shapely.prepare(polygon)
                if shapely.dwithin(polygon, others[near], APART_M).any():
                    continue
            room = None if beside is None else room_for(beside, polygon, yaw)
            if room is not None and not (
                shapely.contains_properly(self._allowed, room)
                and (not self._taken or not shapely.intersects(room, others).any())
            ):
                continue
            return Point(x, y), yaw, polygon, (along, offset)
        return None


def _defect(
    segment: Segment, kind: DefectKind, shape: Heightfield, seed: int, parameters: ShapeParameters, placed: Placed
) -> Defect:
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
        parameters=parameters,
    )


MADE_BY: Final = ("defects", "world")
"""The folders of the package whose code and data decide where defects lie."""

_STORE: Final = ValueStore("placed defects", (Defect, Severity))


def placed_on(
    world: World,
    segments: Sequence[Segment],
    seed: int,
    options: DefectOptions | None = None,
    threads: int | None = None,
) -> tuple[Defect, ...]:
    """Place defects as `place` does, or read them from the cache.

    Nothing is kept of a world without a content hash, which was never built, nor with classes of a user's own, whose
    code may change unseen.

    Args:
        segments: of the world, in its order.

    Raises:
        PaveTwinError: as `place`.
    """
    make = partial(place, segments, seed, options, threads=threads)
    whole = (options or DefectOptions()).effective()
    if not world.content_hash or not all(kind.ships for kind, _ in whole.shares()):
        return make()
    inputs = (world.content_hash, [segment.id for segment in segments], seed, whole.model_dump_json())
    return _STORE.kept(cache_folder("defects") / short_sha256(f"{inputs!r} {made_by(*MADE_BY)}"), make)


MOST_PLACERS: Final = 8
"""Processes that place defects at most."""


def build_folder(
    source: Path | NetworkKind,
    folder: Path,
    options: BuildOptions | None = None,
    defects: DefectOptions | None = None,
    *,
    force: bool = False,
    jobs: int | None = 1,
    on_progress: Callable[[float, str], None] = lambda _share, _what: None,
) -> tuple[World, BuildRecord]:
    """Build a world, place its defects, and write it.

    Args:
        force: replace a world that is there.
        jobs: number of processes that place defects; 1 uses threads of this one. None: one per core, 8 at most. They
            import the caller's main module, which must be safe to import (see `multiprocessing`).
        on_progress: receives the share done, 0 … 1, and the step.

    Returns:
        The world, and what it was made from.

    Raises:
        PaveTwinError: as `build_world`, `add_defects` and `save_world`.
    """
    damage = defects or DefectOptions()
    damage.effective()
    check_target(folder, force=force)
    # Placing defects takes as long as all that is before it, for which one core is enough.
    with started(_placers(jobs), __name__) as waiting:
        built = build_world(source, options, lambda what, share: on_progress(0.25 * share, what))
        damaged = add_defects(built, damage, lambda share: on_progress(0.25 + 0.7 * share, "defects"), waiting)
    world = save_world(damaged, folder, force=force)
    on_progress(1.0, "world")
    return world, built.record


def _placers(jobs: int | None) -> int:
    """Number of processes that place defects; 0 for a single one, or if none may be started."""
    most = min(cores(), MOST_PLACERS) if jobs is None else jobs
    return most if most > 1 and may_start() else 0
