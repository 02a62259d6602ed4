"""A recording: every agent's pose at every step, with the properties of agents and signals."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Final, Self

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt32Array
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import DEFAULT_MIX, TOLERANCE, USER, WARM_UP_S, Capacity, Density, level_of
from pavetwin.traffic.kinds import AgentClass
from pavetwin.traffic.tracks import AgentTracks, PoseRows

SAMPLED_S: Final = 5.0
"""Speed limits are looked up in frames this far apart: within it a vehicle rarely changes the kind of street."""

SIZES: Final = ("length_m", "width_m", "height_m")

REMOVED_REMARK: Final = 0.1
"""A larger share of removed vehicles, of those present at a time, becomes a remark."""


@dataclass(frozen=True, eq=False)
class Agents:
    """The agents, in the order of first appearance. All arrays (agents,)."""

    id: tuple[str, ...]
    """SUMO's."""
    kind: tuple[str, ...]
    """Kind of `kinds.KINDS`, or the vehicle class of a user's own type."""
    length_m: Float32Array
    width_m: Float32Array
    height_m: Float32Array
    is_pedestrian: BoolArray

    def __post_init__(self) -> None:
        for name in ("kind", *SIZES, "is_pedestrian"):
            if len(getattr(self, name)) != len(self.id):
                raise ValueError(f"Agents.{name} has {len(getattr(self, name))} entries for {len(self.id)} agents")

    def __len__(self) -> int:
        return len(self.id)

    def agent_class(self, agent: int) -> AgentClass:
        return AgentClass.PEDESTRIAN if self.is_pedestrian[agent] else AgentClass.VEHICLE

    def first(self, count: int) -> "Agents":
        """The first `count` to appear."""
        return Agents(*(getattr(self, each.name)[:count] for each in fields(self)))


@dataclass(frozen=True, slots=True)
class Origin:
    """Inputs of a recording."""

    world: str
    """The world's content hash."""
    inputs: str
    """Hash of all inputs except the duration."""
    seed: int
    asked: Density | None
    """Density; None for a user's own routes."""
    capacity: Capacity
    sumo_version: str
    warm_up_s: float
    """Simulated time before the recording."""
    area: TrafficArea | None = None
    """Area with traffic; None for the whole town."""

    @property
    def mix(self) -> str:
        """Name of the mix of vehicles; the default one for a user's own routes."""
        return self.asked.mix if self.asked else DEFAULT_MIX


@dataclass(frozen=True, eq=False)
class Recording:
    """Traffic from time 0 to `duration_s`, a frame every `step_s`, both ends included."""

    origin: Origin
    step_s: float
    agents: Agents
    tracks: AgentTracks
    removals: tuple[tuple[int, int], ...]
    """(step, how many): vehicles that SUMO removed after they had blocked traffic (its teleports)."""
    signals: Mapping[str, tuple[tuple[int, str], ...]]
    """Per traffic light of the network: (step, state of its links, SUMO's letters) at step 0 and at each change."""
    path: Path | None = field(default=None)
    """File, which may hold a longer recording."""
    at_limits: Float64Array | None = field(default=None)
    """(samples, 2): of the frames at 0, `SAMPLED_S`, 2 · `SAMPLED_S` …, the sums over vehicles of speed, and of speed
    over the speed limit where they are (`flow.at_limits`). None in a world without lanes."""

    @classmethod
    def of_rows(
        cls,
        *,
        origin: Origin,
        step_s: float,
        agents: Agents,
        rows: PoseRows,
        removals: tuple[tuple[int, int], ...] = (),
        signals: Mapping[str, tuple[tuple[int, str], ...]],
        path: Path | None = None,
    ) -> Self:
        """Create a recording from all poses."""
        tracks = AgentTracks.of(rows, agents.is_pedestrian, step_s)
        return cls(origin, step_s, agents, tracks, removals, signals, path)

    @property
    def frames(self) -> int:
        return self.tracks.frames

    @property
    def duration_s(self) -> float:
        return (self.frames - 1) * self.step_s

    @property
    def step_offsets(self) -> UInt32Array:
        """(frames + 1,): as all columns of `PoseRows`, for what needs every pose in memory."""
        return self.tracks.rows.step_offsets

    @property
    def agent(self) -> UInt32Array:
        return self.tracks.rows.agent

    @property
    def x(self) -> Float32Array:
        return self.tracks.rows.x

    @property
    def y(self) -> Float32Array:
        return self.tracks.rows.y

    @property
    def yaw_rad(self) -> Float32Array:
        return self.tracks.rows.yaw_rad

    @property
    def speed_mps(self) -> Float32Array:
        return self.tracks.rows.speed_mps

    @property
    def name(self) -> str:
        """Name of its density: low, medium, high, one from numbers, a level of service, an hour, or `user`."""
        return self.origin.asked.name if self.origin.asked else USER

    @property
    def counts(self) -> tuple[Int64Array, Int64Array]:
        """Vehicles and pedestrians in each frame, two arrays (frames,)."""
        return self.tracks.numbers.vehicles, self.tracks.numbers.pedestrians

    @property
    def is_empty(self) -> bool:
        """Whether the streets are empty at all times."""
        return not any(count.any() for count in self.counts)

    @property
    def vehicles_per_lane_km(self) -> float | None:
        """Achieved: the mean over the recording; None in a world without lanes."""
        lanes_km = self.origin.capacity.lanes_km
        return float(self.counts[0].mean()) / lanes_km if lanes_km > 0 else None

    @property
    def pedestrians_per_sidewalk_km(self) -> float | None:
        """Achieved: the mean over the recording; None in a world without sidewalks."""
        sidewalks_km = self.origin.capacity.sidewalks_km
        return float(self.counts[1].mean()) / sidewalks_km if sidewalks_km > 0 else None

    @property
    def speed_mps_of_vehicles(self) -> float | None:
        """Space mean speed: distance over time of all vehicles; None without vehicles."""
        numbers = self.tracks.numbers
        return float(numbers.speed_mps.sum() / numbers.vehicles.sum()) if numbers.vehicles.any() else None

    @property
    def free_flow_mps(self) -> float | None:
        """Mean speed that the vehicles would have had at the speed limits; None where nothing moved."""
        driven, at_limit = (0.0, 0.0) if self.at_limits is None else self.at_limits.sum(axis=0)
        return float(driven / at_limit) if at_limit > 0 else None

    @property
    def speed_ratio(self) -> float | None:
        """Mean speed over free-flow speed; None where either is not known."""
        if self.speed_mps_of_vehicles is None or not self.free_flow_mps:
            return None
        return self.speed_mps_of_vehicles / self.free_flow_mps

    @property
    def removed(self) -> int:
        """Number of vehicles removed after blocking traffic."""
        return sum(count for _, count in self.removals)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings for the user: a density not reached, gridlock, routes that end early."""
        return tuple(_remarks(self))

    @property
    def warm_up_s(self) -> float:
        """Default take-off of missions: at once where a density is held; as over a user's own demand
        where it was recorded from one (see `own_demand`), but in its first half.
        """
        if self.origin.asked is not None:
            return 0.0
        known = self.tracks.numbers.known
        vehicles = np.flatnonzero(~self.agents.is_pedestrian[: known[-1]])
        if not len(vehicles):
            return 0.0
        last = int(np.searchsorted(known, vehicles[-1] + 1))  # the frame in which the last vehicle appears
        return float(math.floor(min(WARM_UP_S, last * self.step_s, self.duration_s / 2)))

    def agents_at(self, time_s: float) -> tuple[int, int]:
        """Numbers of vehicles and pedestrians on the streets at a moment."""
        vehicles, pedestrians = self.counts
        frame = min(round(time_s / self.step_s), self.frames - 1)
        return int(vehicles[frame]), int(pedestrians[frame])

    def until(self, duration_s: float) -> "Recording":
        """The first `duration_s` seconds.

        Raises:
            ValueError: the recording is shorter.
        """
        frames = frames_of(duration_s, self.step_s)
        if frames > self.frames:
            raise ValueError(f"The recording lasts {self.duration_s:g} s, not {duration_s:g} s")
        if frames == self.frames:
            return self
        return replace(self._between(0, frames), agents=self.agents.first(int(self.tracks.numbers.known[frames - 1])))

    def after(self, start_s: float) -> "Recording":
        """The recording from `start_s` on, with that as time 0; agents keep their numbers.

        Raises:
            ValueError: the recording ends before.
        """
        first = round(start_s / self.step_s)
        if not 0 <= first < self.frames:
            raise ValueError(f"The recording lasts {self.duration_s:g} s and holds nothing from {start_s:g} s on")
        return self._between(first, self.frames) if first > 0 else self

    def _between(self, first: int, end: int) -> "Recording":
        """The frames from `first` up to but not `end`."""
        every = round(SAMPLED_S / self.step_s)
        samples = slice(-(-first // every), -(-end // every))
        return replace(
            self,
            tracks=self.tracks.between(first, end),
            at_limits=None if self.at_limits is None else self.at_limits[samples],
            removals=tuple((step - first, count) for step, count in self.removals if first <= step < end),
            signals={name: _between(states, first, end) for name, states in self.signals.items()},
        )

    def same_traffic(self, other: "Recording") -> bool:
        """Whether agents, poses and signals are exactly equal."""
        return (
            (self.agents.id, self.signals, self.step_s) == (other.agents.id, other.signals, other.step_s)
            and self.frames == other.frames
            and all(
                np.array_equal(getattr(self.agents, name), getattr(other.agents, name))
                for name in (*SIZES, "is_pedestrian")
            )
            and self.tracks.begin_alike(other.tracks)
        )


def frames_of(duration_s: float, step_s: float) -> int:
    """Number of frames that cover 0 … `duration_s`, both ends included."""
    return math.ceil(duration_s / step_s - 1e-9) + 1


def _between(states: tuple[tuple[int, str], ...], first: int, end: int) -> tuple[tuple[int, str], ...]:
    """A signal's states from a step up to but not another, with the state at the first as step 0."""
    held = [state for step, state in states if step <= first]
    later = tuple((step - first, state) for step, state in states if first < step < end)
    return ((0, held[-1]), *later) if held else later


def _remarks(recording: Recording) -> list[str]:
    asked, remarks = recording.origin.asked, []
    vehicles, _ = recording.counts
    if asked is None:
        busy = np.flatnonzero(vehicles)
        last = (int(busy[-1]) + 1) * recording.step_s if len(busy) else 0.0
        if last < recording.duration_s:
            remarks.append(f"the routes end early: from {last:g} s on no vehicle is on the streets")
    else:
        cars, walkers = recording.vehicles_per_lane_km, recording.pedestrians_per_sidewalk_km
        wanted = None if asked.is_found or recording.origin.area else asked.vehicles_per_lane_km
        remarks += _missed("vehicles", "lane", wanted, cars)
        remarks += _missed("pedestrians", "sidewalk", asked.pedestrians_per_sidewalk_km, walkers)
        level = asked.level if recording.origin.area is None else None  # an area has the town's density
        if level and recording.speed_ratio is not None and not level.holds(recording.speed_ratio):
            flows = f"{100 * recording.speed_ratio:.0f} % of the free-flow speed"
            remarks.append(
                f"traffic keeps {flows}, which is level of service {level_of(recording.speed_ratio)} instead of {level}"
            )
    if recording.removed > REMOVED_REMARK * max(1.0, float(vehicles.mean())):
        remarks.append(
            f"{recording.removed} vehicles were removed after blocking traffic (SUMO teleports); treat the density "
            "with care"
        )
    return remarks


def _missed(who: str, way: str, wanted: float | None, achieved: float | None) -> list[str]:
    if wanted is None:
        return []
    if achieved is None:
        return [f"the world has no {way}s, so there are no {who}"] if wanted > 0 else []
    if abs(achieved - wanted) > TOLERANCE * wanted:
        missed = f"{achieved:.1f} {who} per {way}-kilometre instead of {wanted:g}"
        return [f"{missed}: outside ±{TOLERANCE * 100:.0f} % of what was asked"]
    return []
