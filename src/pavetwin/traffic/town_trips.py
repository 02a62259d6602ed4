"""The trips of a town's vehicles, observed once for each density and mix: what the traffic of its areas is made from.

They are observed in one simulation without pedestrians, which takes a third of the time of one with them: of the whole
town, or in a city of the streets around the area, so that it takes no longer there. Where vehicles are does not depend
much on the seed of traffic, so all seeds share it. How well areas agree with their town: docs/explanation/traffic.md,
"Area".
"""

import hashlib
import json
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Final
from zipfile import BadZipFile

import numpy as np

from pavetwin.files import writing
from pavetwin.traffic.area import may_be_observed_in_part
from pavetwin.traffic.demand import Density
from pavetwin.traffic.demand_search import search_for_areas
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.job import STEP_S, AreaTraffic, Trip
from pavetwin.traffic.runner import OnRecorded, SimulationProcess, require_sumo, workplace
from pavetwin.world.cache import cached
from pavetwin.world.model import World

OBSERVED_S: Final = 600.0
"""Some cycles of signals, in which most of a town's vehicles are replaced."""

SEED: Final = 0
"""Duration of the observation."""

_DAMAGED: Final = (OSError, ValueError, KeyError, EOFError, BadZipFile)


def with_area_traffic(inputs: Inputs, on_progress: OnRecorded | None = None) -> Inputs:
    """The inputs with the vehicles of their area, whose density is known; the same inputs for a whole town.

    Args:
        on_progress: receives the share done of the observation, where it is not in the cache.

    Raises:
        PaveTwinError: SUMO is missing or refuses its input, or the file cannot be written.
    """
    if inputs.area is None or inputs.asked is None:
        return inputs
    town = replace(inputs, area=inputs.observed_on, seed=SEED)
    length_m = {lane.edge: lane.length_m for lane in inputs.world.lanes}
    trips = trips_of(town, on_progress)
    return replace(inputs, area_traffic=AreaTraffic.of(trips, frozenset(inputs.area.edges), OBSERVED_S, length_m))


def observe(world: World, asked: Density, on_progress: OnRecorded | None = None) -> None:
    """Keep the trips that areas of a world have at a density, a level of service or an hour, where all have the same.

    Raises:
        PaveTwinError: as `with_area_traffic`, or the world cannot reach the level of service.
    """
    density = search_for_areas(world, asked.mix, on_progress).density(asked) if asked.is_found else asked
    if may_be_observed_in_part(world):
        return  # each area on streets of its own
    trips_of(Inputs.of(world, density, SEED), on_progress)


def trips_of(town: Inputs, on_progress: OnRecorded | None = None) -> Sequence[Trip]:
    """The trips of a whole town, or of some streets of it, during `OBSERVED_S` after the warm-up, from the cache or
    from SUMO.

    Raises:
        PaveTwinError: as `with_area_traffic`.
    """
    assert town.asked is not None
    key = hashlib.sha256(json.dumps([town.hash, OBSERVED_S, town.asked.vehicles_per_lane_km]).encode()).hexdigest()
    where = "" if town.area is None else f"-{town.area.name}"
    path = cached(town.world, f"traffic/trips-{town.asked.name}{where}.npz")
    with suppress(*_DAMAGED):
        if path.exists() and (known := _read(path, key)) is not None:
            return known
    require_sumo()
    with workplace() as folder:
        job = replace(town.job(folder), pedestrians=0, reads_trips=True)
        with closing(SimulationProcess(job)) as simulation:
            trips = simulation.record(round(OBSERVED_S / STEP_S), on_progress).trips
    _write(path, key, trips)
    return trips


def _write(path: Path, key: str, trips: Sequence[Trip]) -> None:
    edges = sorted({edge for trip in trips for edge in trip.edges})
    number = {edge: at for at, edge in enumerate(edges)}
    with writing(path) as temporary:
        np.savez_compressed(
            temporary,
            key=np.array(key),
            edges=np.array(edges, dtype=str),
            kind=np.array([trip.kind for trip in trips], dtype=str),
            count=np.array([len(trip.edges) for trip in trips], dtype=np.int64),
            left_s=np.array([trip.left_s for trip in trips]),
            edge=np.array([number[edge] for trip in trips for edge in trip.edges], dtype=np.int64),
            entered_s=np.array([*chain.from_iterable(trip.entered_s for trip in trips)], dtype=np.float64),
        )


def _read(path: Path, key: str) -> list[Trip] | None:
    """The trips of a file; None where they were made from something else."""
    with np.load(path, allow_pickle=False) as file:
        if str(file["key"]) != key:
            return None
        names, kinds, left_s = file["edges"].tolist(), file["kind"].tolist(), file["left_s"].tolist()
        edges, entered_s = [names[at] for at in file["edge"].tolist()], file["entered_s"].tolist()
        ends = np.cumsum(file["count"]).tolist()
    if len(edges) != len(entered_s) or len(edges) != (ends[-1] if ends else 0) or len(kinds) != len(left_s):
        raise ValueError("columns of different lengths")
    return [
        Trip(kind, tuple(edges[begin:end]), tuple(entered_s[begin:end]), left)
        for kind, begin, end, left in zip(kinds, [0, *ends], ends, left_s, strict=False)
    ]
