"""Assignment of whole streets to train, val and test, so that no defect is seen in two of them.

It depends on the world, the seed and the shares only: datasets of one world and seed can be joined, on any platforms.
Of many assignments the one nearest to the target shares of each class's defects and of the traffic is taken, with the
fewest separated streets that meet: no image can be taken where streets of two splits meet. Streets count the recorded
traffic on them, since images of an empty street hold no vehicle to train or test on.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import Final

import numpy as np
import shapely

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.capture.samples import STREETS
from pavetwin.errors import PaveTwinError
from pavetwin.labels import SPLITS
from pavetwin.seeds import Stream, child
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.world.cache import ValueStore, cache_folder, made_by, short_sha256
from pavetwin.world.model import World

SAMPLED_S: Final = 10.0
"""Interval at which agents are counted."""

BESIDE_M: Final = 5.0
"""People on sidewalks, and agents on a junction, count as on the street whose carriageway is this near."""


def presence(world: World, recordings: Iterable[Recording]) -> Mapping[str, Float64Array]:
    """Street → (2,) mean number of vehicles and people on it at a time, over all recordings."""
    names, street = np.unique([segment.street for segment in world.segments], return_inverse=True)
    tree = shapely.STRtree([segment.polygon for segment in world.segments])
    counts = np.zeros((len(names), 2))
    for recording in recordings:
        frames = range(0, recording.frames, max(1, round(SAMPLED_S / recording.step_s)))
        offsets = recording.step_offsets
        rows = np.concatenate([np.arange(offsets[frame], offsets[frame + 1]) for frame in frames])
        places = shapely.points(recording.x[rows].astype(np.float64), recording.y[rows].astype(np.float64))
        which, nearest = tree.query_nearest(places, max_distance=BESIDE_M, all_matches=False)
        walks = recording.agents.is_pedestrian[recording.agent[rows[which]]].astype(np.intp)
        np.add.at(counts, (street[nearest], walks), 1 / len(frames))
    return dict(zip(names.tolist(), counts, strict=True))


STARTS: Final = 96  # Number of random starts of the local search; the best result is taken
MEETING_M: Final = 30.0  # Streets nearer to each other than this can be in one image

PARTING_WEIGHT: Final = 0.25
"""Cost of separating all streets that meet; 1 is the cost of missing every share completely."""


TRAFFIC: Final = "medium"  # Density of the recording whose agents are shared out, whichever densities the images show

RECORDED_S: Final = 600.0
"""Duration of recorded traffic."""


MADE_BY: Final = ("capture", "traffic", "world")  # The folders of the package whose code and data decide the splits

_STORE: Final = ValueStore("splits of streets", ())


@dataclass(frozen=True)
class _Town:
    counts: Float64Array
    """(streets, classes) of defects and of agents, as shares of each class."""
    meets: Float64Array
    """(streets, streets) 1 where two meet, scaled to sum to 1."""
    reached: BoolArray
    """(streets,) of which images can be taken; only these count for the shares."""
    target: Float64Array
    """(splits,)"""

    @cached_property
    def wanted(self) -> Float64Array:
        """(splits, classes) of the shares of each class that there is."""
        return np.asarray(self.target[:, None] * (self.counts.sum(axis=0) > 0))

    @cached_property
    def alone(self) -> Float64Array:
        """(splits, splits) 1 where both are the same."""
        return np.eye(len(self.target))

    @cached_property
    def open_splits(self) -> IndexArray:
        """Splits that receive streets."""
        return np.flatnonzero(self.target > 0)

    @cached_property
    def any_meet(self) -> bool:
        """True if any two streets meet."""
        return bool(self.meets.any())


def street_splits(
    world: World, seed: int, shares: Sequence[float], on_progress: Callable[[float], None] | None = None
) -> Mapping[str, str]:
    """The split of every street that has defects, from the cache where it was found before; else traffic is recorded
    where no recording exists. Nothing is kept of a world without a content hash, which was never built.

    Raises:
        PaveTwinError: there are fewer streets with defects than splits, or the traffic cannot be recorded.
    """

    def found() -> dict[str, str]:
        recording = record(world, TRAFFIC, seed, RECORDED_S, on_progress=on_progress)
        agents = presence(world, [recording])
        return dict(split_streets(world, shares, child(seed, Stream.CAPTURE, STREETS), agents))

    if not world.content_hash:
        return found()
    try:
        sumo = version("libsumo")
    except PackageNotFoundError:
        return found()  # raises with what to install
    inputs = (world.content_hash, world.defects_hash, seed, tuple(shares), sumo)
    return _STORE.kept(cache_folder("splits") / short_sha256(f"{inputs!r} {made_by(*MADE_BY)}"), found)


def split_streets(
    world: World,
    shares: Sequence[float],
    rng: np.random.Generator,
    agents: Mapping[str, Float64Array] | None = None,
) -> Mapping[str, str]:
    """The split of every street that has defects.

    Args:
        shares: of train, val and test; one of 0 gets no street.
        agents: street → (2,) mean number of vehicles and people on it; none unless given. Streets without vehicles join
            the split that they meet most, since no car takes images there; unless too few streets have any.

    Raises:
        PaveTwinError: there are fewer streets with defects than splits.
    """
    names = defect_streets(world, shares)
    street_of = {segment.id: segment.street for segment in world.segments}
    target = np.array(shares, dtype=np.float64)
    none = np.zeros(2)
    present = np.array([(agents or {}).get(name, none) for name in names])
    within = present[:, 0] > 0
    if within.sum() < np.count_nonzero(target):
        within[:] = True
    counts = np.hstack([_defects(world, names, street_of), present])
    counts[~within] = 0.0
    counts /= np.maximum(counts.sum(axis=0), np.finfo(np.float64).tiny)
    town = _Town(counts, _meetings(world, names), within, target)
    # Searches from different starts end at the same assignments.
    cost_of = lru_cache(None)(lambda splits: _cost(town, np.frombuffer(splits, dtype=np.intp)))
    best, least = np.empty(0, dtype=np.intp), np.inf
    for _ in range(STARTS):
        chosen = _improved(town, _started(town, rng), cost_of)
        cost = cost_of(chosen.tobytes())
        if cost < least - 1e-12:
            best, least = chosen, cost
    return {name: SPLITS[split] for name, split in zip(names, best.tolist(), strict=True)}


def defect_streets(world: World, shares: Sequence[float]) -> list[str]:
    """The streets that have defects, sorted.

    Args:
        shares: of train, val and test.

    Raises:
        PaveTwinError: there are fewer of them than splits that get any.
    """
    street_of = {segment.id: segment.street for segment in world.segments}
    names = sorted({street_of[defect.segment] for defect in world.defects})
    if len(names) < np.count_nonzero(shares):
        streets = "1 street" if len(names) == 1 else f"{len(names)} streets"
        raise PaveTwinError(
            f"The world '{world.name}' has {streets} with defects, and train, val and test each need streets of their "
            "own; use a larger world, or `split` 100/0/0."
        )
    return names


def _defects(world: World, names: Sequence[str], street_of: Mapping[str, str]) -> Float64Array:
    kinds = sorted({defect.kind for defect in world.defects})
    found = Counter((street_of[defect.segment], defect.kind) for defect in world.defects)
    return np.array([[found[name, kind] for kind in kinds] for name in names], dtype=np.float64)


def _meetings(world: World, names: Sequence[str]) -> Float64Array:
    row = {name: i for i, name in enumerate(names)}
    segments = [segment for segment in world.segments if segment.street in row]
    polygons = np.array([segment.polygon for segment in segments], dtype=object)
    streets = np.array([row[segment.street] for segment in segments])
    one, other = shapely.STRtree(polygons).query(polygons, predicate="dwithin", distance=MEETING_M)
    meets = np.zeros((len(names), len(names)))
    meets[streets[one], streets[other]] = 1.0
    np.fill_diagonal(meets, 0.0)
    return np.asarray(meets / max(1.0, float(meets.sum())))


def _started(town: _Town, rng: np.random.Generator) -> IndexArray:
    """Assign streets in random order, each to the split that is furthest below its share."""
    chosen = np.zeros(len(town.counts), dtype=np.intp)
    lacking = np.where(town.target > 0, town.target, -np.inf)
    sizes = town.counts.sum(axis=1) / town.counts.sum()
    for street in rng.permutation(len(town.counts)):
        chosen[street] = int(np.argmax(lacking))
        lacking[chosen[street]] -= sizes[street]
    return chosen


def _improved(town: _Town, chosen: IndexArray, cost_of: Callable[[bytes], float]) -> IndexArray:
    """Local search: move each street to the split of least cost, until no move helps.

    `cost_of` gives the cost of an assignment by its bytes.
    """
    chosen = chosen.copy()
    cost, moved = cost_of(chosen.tobytes()), True
    while moved:
        moved = False
        for street in range(len(chosen)):
            before = chosen[street]
            for split in town.open_splits:
                chosen[street] = split
                other = cost_of(chosen.tobytes())
                if other < cost - 1e-12:
                    cost, before, moved = other, split, True
            chosen[street] = before
    return chosen


def _cost(town: _Town, chosen: IndexArray) -> float:
    inside = town.alone[chosen]
    missed = np.abs(inside.T @ town.counts - town.wanted).sum() / town.counts.shape[1]
    parted = 1.0 - float(np.vdot(inside, town.meets @ inside)) if town.any_meet else 0.0
    used = np.bincount(chosen[town.reached], minlength=len(town.target))
    unused = np.count_nonzero(used[town.open_splits] == 0)
    return float(missed) + PARTING_WEIGHT * parted + 10.0 * unused
