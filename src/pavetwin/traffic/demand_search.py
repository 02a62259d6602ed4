"""The density at which a world's traffic flows at a level of service, or carries that of an hour of a weekday.

Found by closed loop: short simulations at trial densities, each with its speed ratio and flow measured as of any
recording (`flow`). Over a network's density k speed falls like v₀ exp(−½ (k/kₘ)²) (Drake, Schofer and May 1967; for
whole networks Geroliminis and Daganzo 2008), with v₀ from a nearly empty network and its own kₘ from the last trial:
that gives the next one, and trials on both sides bound it. The result is read off the curve that fits them best.

The first two trials, the nearly empty network and a guess, run side by side. The search is the same under every seed of
traffic, since the density is a property of the streets. Its trials are kept next to the recordings.

Without a requested level of service the usual one is recorded, or the nearest that the world can reach.
"""

import hashlib
import itertools
import json
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from math import log, sqrt
from typing import Final

import numpy as np

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import (
    BUSIEST,
    JAM_VEHICLES_PER_LANE_KM,
    Density,
    LevelOfService,
    density_named,
    level_density,
    level_of,
    share_of_busiest,
)
from pavetwin.traffic.flow import flow_of, to_recording
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.job import STEP_S, Part
from pavetwin.traffic.runner import OnRecorded, SimulationProcess, require_sumo, workplace
from pavetwin.world.cache import cached
from pavetwin.world.model import LaneKind, World

NEAR: Final = 0.10
"""A trial within this of the target, as a share of it, is near: what a recording may miss it by."""

NEAREST: Final = 0.04
"""Tolerance within which one trial ends the search."""

WEIGHED: Final = 0.25
"""A trial whose speed ratio is off the target by this much (natural logarithm) weighs 0.6 of one that is on it."""

MOST_TRIALS: Final = 8
"""Trials of one search, the first included."""

SEED: Final = 0
"""Seed of the trials."""

EMPTY_PER_LANE_KM: Final = 1.0
FEWEST: Final = 4
"""Vehicles of the nearly empty network: so many per kilometre of lane, and no fewer."""

MEASURED_VEHICLE_S: Final = 24_000.0
MEASURED_S: Final = (240.0, 600.0)
"""A trial is measured for so many vehicle-seconds, within these limits of time."""

FULLEST_PER_LANE_KM: Final = 0.75 * JAM_VEHICLES_PER_LANE_KM
"""No trial is denser."""

SEARCHED_LANES_KM: Final = 10.0
"""Kilometres of lane that are searched over for areas of a larger world: those of the demo's town."""

RING_M: Final = 50
"""The middle of a world grows by this distance until it has so many."""

FIRST_SCALE_PER_LANE_KM: Final = 11.0
"""kₘ before the first trial: of the towns tried it was 12 to 15 at C, and up to 19 in denser traffic."""

FIRST_EMPTY_RATIO: Final = 0.72
"""Speed ratio of the nearly empty network before the first trial: of the towns tried it was 0.69 to 0.78."""


class UnreachableError(PaveTwinError):
    """No density of vehicles flows at the level of service in the world."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A density, and what it led to."""

    per_lane_km: float
    ratio: float
    flow_per_lane_h: float
    removed_per_vehicle_hour: float


def found(inputs: Inputs, on_search: OnRecorded | None = None) -> Inputs:
    """The inputs with a density, searched for where it is not known yet.

    Args:
        on_search: receives the share done of the search.

    Raises:
        PaveTwinError: the world cannot reach the level of service, or SUMO fails.
    """
    asked = inputs.asked
    if asked is None or not asked.is_found:
        return inputs
    if inputs.area is not None:
        return replace(inputs, asked=search_for_areas(inputs.world, asked.mix, on_search).density(asked))
    search = DemandSearch(inputs.world, asked.mix, on_search)
    ratio = search.target(asked.level)[1] if asked.level else None
    return replace(inputs, asked=search.density(asked), speed_ratio=ratio)


def search_for_areas(world: World, mix: str, on_progress: OnRecorded | None = None) -> "DemandSearch":
    """The search for the density at which all areas of a world are recorded: over its middle where the world is large,
    so that it takes no longer in a city than in a town."""
    return DemandSearch(world, mix, on_progress, middle_of(world))


def middle_of(world: World) -> TrafficArea | None:
    """The smallest area around the middle of a world's segments with `SEARCHED_LANES_KM` of lanes or more; None for the
    whole world if it has less than twice as much."""
    if not world.segments or world.length_km(LaneKind.DRIVING) < 2 * SEARCHED_LANES_KM:
        return None
    places = np.array([segment.centre_line.centroid.coords[0] for segment in world.segments])
    middle = np.median(places, axis=0)
    nearest = world.segments[int(np.argmin(np.hypot(*(places - middle).T)))].id
    for distance_m in itertools.count(RING_M, RING_M):
        area = TrafficArea.around(world, [nearest], float(distance_m), most_share=1.0)
        if area is None or area.length_km(world) >= SEARCHED_LANES_KM:
            return area
    raise AssertionError


class DemandSearch:
    """Searches in one world under one mix of vehicles."""

    def __init__(
        self, world: World, mix: str, on_progress: OnRecorded | None = None, area: TrafficArea | None = None
    ) -> None:
        """
        Args:
            area: the streets to search over; None for all.
        """
        asked = replace(_level_of_trials(mix), vehicles_per_lane_km=EMPTY_PER_LANE_KM)
        self._inputs = Inputs(world, asked, SEED, area=area)
        self._report = on_progress or (lambda _: None)
        self._name = f"traffic/demand-{mix}{'' if area is None else f'-{area.name}'}.json"
        self._hash = hashlib.sha256(
            json.dumps([self._inputs.hash, MEASURED_VEHICLE_S, *MEASURED_S]).encode()
        ).hexdigest()
        self._known = self._read()
        self._done = 0

    @property
    def trials(self) -> list[Trial]:
        """All that were made so far in this world, by density."""
        return [trial for _, trial in sorted(self._known.items())]

    def trial(self, per_lane_km: float) -> Trial:
        """Trial of a density, simulated where it is not known."""
        self._simulate(per_lane_km)
        return self._known[self._count(per_lane_km)]

    def density(self, asked: Density) -> Density:
        """`asked` with the density that was found.

        Raises:
            PaveTwinError: the world cannot reach the level of service.
        """
        if asked.hour is not None:
            return replace(asked, vehicles_per_lane_km=self._of_hour(asked.hour))
        return replace(asked, vehicles_per_lane_km=self.of_level(asked.level)[0]) if asked.level else asked

    def of_level(self, level: LevelOfService) -> tuple[float, list[Trial]]:
        """Vehicles per kilometre of lane, and the trials that show it, of which the first is nearly empty.

        Raises:
            UnreachableError: the world cannot reach the level of service.
        """
        empty, target = self.target(level)
        trials: list[Trial] = []
        usual = FIRST_EMPTY_RATIO if _is_usual(level) else empty.ratio
        guess, below, above = _first_guess(level, usual), 0.0, FULLEST_PER_LANE_KM
        while len(trials) < MOST_TRIALS - 1 and not _ends(trials, target):
            trial = self.trial(guess)
            if trial in trials:
                break  # no vehicle more or less
            trials.append(trial)
            if trial.ratio > target:
                below = max(below, trial.per_lane_km)
            else:
                above = min(above, trial.per_lane_km)
            width = max(above - below, 0.0)
            guess = min(max(_projected(trial, empty, target), below + 0.1 * width), above - 0.1 * width)
        best = min(trials, key=lambda it: abs(it.ratio / target - 1))
        if not level.holds(best.ratio):
            raise UnreachableError(
                f"No density was found at which traffic in '{self._inputs.world.name}' flows at level of service "
                f"{level}: {best.per_lane_km:.0f} vehicles per lane-kilometre keep {100 * best.ratio:.0f} % of the "
                f"speed limits, which is {level_of(best.ratio)}. The network is too small for that; choose another."
            )
        return round(min(FULLEST_PER_LANE_KM, _fitted([empty, *trials], target, best)), 3), [empty, *trials]

    def target(self, level: LevelOfService) -> tuple[Trial, float]:
        """The nearly empty network, and the speed ratio that stands for a level of service in this world.

        Raises:
            UnreachableError: the world cannot reach it.
            PaveTwinError: the world has no lanes.
        """
        name, lanes_km = self._inputs.world.name, self._inputs.capacity.lanes_km
        if not lanes_km > 0:
            raise PaveTwinError(f"The world '{name}' has no lanes, so its traffic has no level of service.")
        nearly_empty = max(EMPTY_PER_LANE_KM, FEWEST / lanes_km)
        if _is_usual(level):
            self._simulate(nearly_empty, _first_guess(level, FIRST_EMPTY_RATIO))
        empty = self.trial(nearly_empty)
        if empty.ratio <= level.above + 0.01:
            best = level_of(empty.ratio)
            raise UnreachableError(
                f"Traffic cannot flow at level of service {level} (above {100 * level.above:.0f} % of the speed "
                f"limits) in '{name}': even nearly empty streets allow {100 * empty.ratio:.0f} %, since vehicles stop "
                f"at signals and slow down to turn. Ask for {best if best is not level else 'the next'} or worse."
            )
        return empty, level.target(empty.ratio)

    def _of_hour(self, hour: int) -> float:
        """The density with the flow of an hour: on the uncongested side, up to that of the busiest hour."""
        busiest, trials = self.of_level(BUSIEST)
        trials = sorted(trials, key=lambda it: it.per_lane_km)
        speeds = [it.flow_per_lane_h / it.per_lane_km for it in trials]
        flow = busiest * float(np.interp(busiest, [it.per_lane_km for it in trials], speeds))
        below = [it for it in trials if it.per_lane_km < busiest]
        densities = [0.0, *(it.per_lane_km for it in below), busiest]
        flows = np.maximum.accumulate([0.0, *(it.flow_per_lane_h for it in below), flow])
        return round(float(np.interp(flows[-1] * share_of_busiest(hour), flows, densities)), 3)

    def _count(self, per_lane_km: float) -> int:
        return max(1, round(per_lane_km * self._inputs.capacity.lanes_km))

    def _simulate(self, *per_lane_km: float) -> None:
        """Make the trials at these densities that are not known, side by side."""
        new = [count for count in dict.fromkeys(map(self._count, per_lane_km)) if count not in self._known]
        if new:
            self._known |= zip(new, self._simulated(*new), strict=True)
            self._write()

    def _simulated(self, *counts: int) -> list[Trial]:
        """Trials with these numbers of vehicles, each in a process of its own."""
        require_sumo()
        trials = []
        with ExitStack() as running:
            simulations = []
            for count in counts:
                inputs = self._inputs_with(count)
                job = replace(inputs.job(running.enter_context(workplace())), reads_pedestrians=False)
                simulation = running.enter_context(closing(SimulationProcess(job)))
                simulation.begin(_measured_frames(count))
                simulations.append((inputs, simulation))
            for inputs, simulation in simulations:
                part = simulation.finish(lambda share: self._report(min(1.0, (self._done + share) / MOST_TRIALS)))
                trials.append(self._measured(inputs, part))
                self._done += 1
        return trials

    def _inputs_with(self, count: int) -> Inputs:
        per_lane_km = round(count / self._inputs.capacity.lanes_km, 3)
        return replace(
            self._inputs, asked=replace(_level_of_trials(self._inputs.mix), vehicles_per_lane_km=per_lane_km)
        )

    def _measured(self, inputs: Inputs, part: Part) -> Trial:
        flow = flow_of(to_recording(part, inputs.origin(part), self._inputs.speed_limits))
        asked = inputs.asked.vehicles_per_lane_km if inputs.asked else None
        return Trial(
            asked or 0.0,
            round(flow.ratio or 0.0, 4),
            round(flow.flow_per_lane_h or 0.0, 2),
            round(flow.removed_per_vehicle_hour or 0.0, 4),
        )

    def _read(self) -> dict[int, Trial]:
        """Stored trials of the same inputs."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            found = json.loads(cached(self._inputs.world, self._name).read_text(encoding="utf-8"))
            if found["inputs"] == self._hash:
                return {int(count): Trial(*values) for count, values in found["trials"].items()}
        return {}

    def _write(self) -> None:
        trials = {
            str(count): [it.per_lane_km, it.ratio, it.flow_per_lane_h, it.removed_per_vehicle_hour]
            for count, it in sorted(self._known.items())
        }
        with writing(cached(self._inputs.world, self._name)) as temporary:
            temporary.write_text(json.dumps({"inputs": self._hash, "trials": trials}, indent=1), encoding="utf-8")


def _measured_frames(count: int) -> int:
    """Frames in which a trial with this many vehicles is measured."""
    least, most = MEASURED_S
    return round(min(most, max(least, MEASURED_VEHICLE_S / count)) / STEP_S)


def _is_usual(level: LevelOfService) -> bool:
    """Whether towns reach a level, so that it can be guessed before the nearly empty network is known."""
    return level.above < FIRST_EMPTY_RATIO


def _first_guess(level: LevelOfService, empty_ratio: float) -> float:
    """Vehicles per kilometre of lane, from the speed ratio of the nearly empty network alone."""
    return FIRST_SCALE_PER_LANE_KM * _bell(empty_ratio, level.target(empty_ratio))


def _ends(trials: list[Trial], target: float) -> bool:
    missed = [abs(trial.ratio / target - 1) for trial in trials]
    return any(miss <= NEAREST for miss in missed) or sum(miss <= NEAR for miss in missed) >= 2


def _bell(empty: float, ratio: float) -> float:
    """k/kₘ at which the speed ratio has fallen from that of the empty network to `ratio`."""
    return sqrt(2 * max(0.0, log(empty / max(ratio, 0.01))))


def _projected(trial: Trial, empty: Trial, target: float) -> float:
    """Density at which the curve through a trial reaches the target."""
    fallen = max(_bell(empty.ratio, trial.ratio), 0.1)
    return trial.per_lane_km * _bell(empty.ratio, target) / fallen


def _fitted(trials: list[Trial], target: float, best: Trial) -> float:
    """The density of the target on the curve ln v = a − b k² through the trials, of which near ones weigh most."""
    square = np.array([trial.per_lane_km**2 for trial in trials])
    fallen = np.array([log(max(trial.ratio, 0.01) / target) for trial in trials])
    weight = np.exp(-0.5 * (fallen / WEIGHED) ** 2)
    b, a = np.polyfit(square, fallen, 1, w=np.sqrt(weight))
    if not (b < 0 < a):
        return best.per_lane_km
    return float(np.clip(np.sqrt(-a / b), best.per_lane_km / 1.5, best.per_lane_km * 1.5))


def _level_of_trials(mix: str) -> Density:
    """Any level of service: all have the same pedestrians and options."""
    return density_named(f"los-{BUSIEST}", mix)


_ORDER: Final = tuple(LevelOfService)


def within_reach(
    world: World, asked: Density, on_search: OnRecorded | None = None, *, of_area: bool = False
) -> Density:
    """`asked`, or where it is a level of service that the world cannot reach, the nearest that it can; of two that are
    as near the worse one.

    Args:
        on_search: receives the share done of the search for a level's demand.
        of_area: whether it is recorded on an area of the world.

    Raises:
        PaveTwinError: the world reaches no level of service at all, or SUMO fails.
    """
    if asked.level is None:
        return asked
    refusals: list[PaveTwinError] = []
    search = search_for_areas if of_area else DemandSearch
    for level in nearest_first(asked.level):
        try:
            search(world, asked.mix, on_search).of_level(level)
        except UnreachableError as error:
            refusals.append(error)
            continue
        return asked if level is asked.level else density_named(level_density(level).name, asked.mix)
    raise refusals[0]


def nearest_first(level: LevelOfService) -> list[LevelOfService]:
    """All levels, the nearest to `level` first; of two that are as near the worse one."""
    at = _ORDER.index(level)
    return sorted(_ORDER, key=lambda other: (abs(_ORDER.index(other) - at), _ORDER.index(other) < at))
