"""A recording: every agent's pose at every step, and its file.

The file is one Parquet table, its rows sorted by (step, agent), with everything else as JSON in its schema's metadata
under the key `pavetwin`. The same recording gives the same bytes.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pavetwin.arrays import BoolArray, Float32Array, Int64Array, UInt32Array
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.traffic.demand import TOLERANCE, USER, Capacity, Density
from pavetwin.traffic.kinds import AgentClass
from pavetwin.traffic.level_of_service import level_of
from pavetwin.traffic.mix import DEFAULT_MIX
from pavetwin.traffic.own_demand import WARM_UP_S
from pavetwin.world.model import World

FORMAT: Final = 1
_KEY: Final = b"pavetwin"
_COLUMNS: Final = ("x", "y", "yaw_rad", "speed_mps")
_SIZES: Final = ("length_m", "width_m", "height_m")

REMOVED_REMARK: Final = 0.1
"""A larger share of removed vehicles, of those present at a time, becomes a remark."""


@dataclass(frozen=True, eq=False)
class Agents:
    """The agents, in the order of first appearance. All arrays (agents,)."""

    id: tuple[str, ...]
    """SUMO's."""
    kind: tuple[str, ...]
    """Of `kinds.KINDS`, or the vehicle class of a user's own type."""
    length_m: Float32Array
    width_m: Float32Array
    height_m: Float32Array
    is_pedestrian: BoolArray

    def __post_init__(self) -> None:
        for name in ("kind", *_SIZES, "is_pedestrian"):
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
    """What a recording was made from."""

    world: str
    """The world's content hash."""
    inputs: str
    """Hash of all inputs except the duration."""
    seed: int
    asked: Density | None
    """None for a user's own routes."""
    capacity: Capacity
    sumo_version: str
    warm_up_s: float
    """Simulated time before the recording."""

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
    step_offsets: UInt32Array
    """(frames + 1,): the rows of step k are step_offsets[k] … step_offsets[k + 1], sorted by agent."""
    agent: UInt32Array
    """(rows,) index in `agents`"""
    x: Float32Array
    """(rows,) centre of the body on the ground, metres east"""
    y: Float32Array
    """(rows,) metres north"""
    yaw_rad: Float32Array
    """(rows,) counter-clockwise from east, −π … π"""
    speed_mps: Float32Array
    """(rows,)"""
    removals: tuple[tuple[int, int], ...]
    """(step, how many): vehicles that SUMO removed after they had blocked traffic (its teleports)."""
    signals: Mapping[str, tuple[tuple[int, str], ...]]
    """Per traffic light of the network: (step, state of its links, SUMO's letters) at step 0 and at each change."""
    path: Path | None = field(default=None)
    """Its file, which may hold a longer recording."""
    free_flow_mps: float | None = field(default=None)
    """The mean speed that the vehicles would have had at the speed limits (`flow.free_flow_mps`); None where nothing
    moved, or in a file of an earlier version."""

    def __post_init__(self) -> None:
        rows = len(self.agent)
        if len(self.step_offsets) < 2 or self.step_offsets[0] != 0 or self.step_offsets[-1] != rows:
            raise ValueError("Recording.step_offsets must begin with 0, end with the number of rows, and hold a frame")
        for name in _COLUMNS:
            column = getattr(self, name)
            if column.shape != (rows,) or column.dtype != np.float32:
                raise ValueError(f"Recording.{name} must be float32 of shape ({rows},)")

    @property
    def frames(self) -> int:
        return len(self.step_offsets) - 1

    @property
    def duration_s(self) -> float:
        return (self.frames - 1) * self.step_s

    @property
    def name(self) -> str:
        """Of its density: low, medium, high, one from numbers, a level of service, an hour, or `user`."""
        return self.origin.asked.name if self.origin.asked else USER

    @cached_property
    def counts(self) -> tuple[Int64Array, Int64Array]:
        """Vehicles and pedestrians in each frame, two arrays (frames,)."""
        offsets = self.step_offsets.astype(np.int64)
        walkers = np.zeros(len(self.agent) + 1, dtype=np.int64)
        np.cumsum(self.agents.is_pedestrian[self.agent], out=walkers[1:])
        pedestrians: Int64Array = walkers[offsets[1:]] - walkers[offsets[:-1]]
        return offsets[1:] - offsets[:-1] - pedestrians, pedestrians

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

    @cached_property
    def speed_mps_of_vehicles(self) -> float | None:
        """Space mean speed: distance over time of all vehicles; None without vehicles."""
        speed = self.speed_mps[~self.agents.is_pedestrian[self.agent]]
        return float(speed.mean(dtype=np.float64)) if len(speed) else None

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
        """When missions take off unless told otherwise: at once where a density is held; as over a user's own demand
        where it was recorded from one (see `own_demand`), but in its first half.
        """
        if self.origin.asked is not None:
            return 0.0
        agents, rows = np.unique(self.agent[~self.agents.is_pedestrian[self.agent]], return_index=True)
        if not len(agents):
            return 0.0
        vehicle_rows = np.flatnonzero(~self.agents.is_pedestrian[self.agent])[rows]
        last = int(np.searchsorted(self.step_offsets, vehicle_rows.max(), side="right")) - 1
        return float(math.floor(min(WARM_UP_S, last * self.step_s, self.duration_s / 2)))

    def agents_at(self, time_s: float) -> tuple[int, int]:
        """How many vehicles and pedestrians are on the streets at a moment."""
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
        rows = int(self.step_offsets[frames])
        count = int(self.agent[:rows].max()) + 1 if rows else 0
        return replace(self._between(0, frames), agents=self.agents.first(count))

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
        rows = slice(int(self.step_offsets[first]), int(self.step_offsets[end]))
        columns: dict[str, Any] = {name: getattr(self, name)[rows] for name in ("agent", *_COLUMNS)}
        return replace(
            self,
            step_offsets=self.step_offsets[first : end + 1] - self.step_offsets[first],
            removals=tuple((step - first, count) for step, count in self.removals if first <= step < end),
            signals={name: _between(states, first, end) for name, states in self.signals.items()},
            **columns,
        )

    def same_traffic(self, other: "Recording") -> bool:
        """Whether agents, poses and signals are exactly equal."""
        arrays = ("step_offsets", "agent", *_COLUMNS)
        return (
            (self.agents.id, self.signals, self.step_s) == (other.agents.id, other.signals, other.step_s)
            and all(np.array_equal(getattr(self, name), getattr(other, name)) for name in arrays)
            and all(
                np.array_equal(getattr(self.agents, name), getattr(other.agents, name))
                for name in (*_SIZES, "is_pedestrian")
            )
        )


def frames_of(duration_s: float, step_s: float) -> int:
    """How many frames cover 0 … `duration_s`, both ends included."""
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
        wanted = None if asked.is_found else asked.vehicles_per_lane_km
        remarks += _missed("vehicles", "lane", wanted, cars)
        remarks += _missed("pedestrians", "sidewalk", asked.pedestrians_per_sidewalk_km, walkers)
        if asked.level and recording.speed_ratio is not None and not asked.level.holds(recording.speed_ratio):
            flows = f"{100 * recording.speed_ratio:.0f} % of the free-flow speed"
            remarks.append(
                f"traffic keeps {flows}, which is level of service {level_of(recording.speed_ratio)} instead of "
                f"{asked.level}"
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


def save_recording(recording: Recording, path: str | Path) -> Recording:
    """Write the recording to `path`, whole or not at all; returns it with its path.

    Raises:
        PaveTwinError: the file cannot be written.
    """
    path = Path(path)
    step = np.repeat(np.arange(recording.frames, dtype=np.int32), np.diff(recording.step_offsets))
    columns = {"step": step, "agent": recording.agent.astype(np.int32)}
    table = pa.table({**columns, **{name: getattr(recording, name) for name in _COLUMNS}})
    text = json.dumps(_metadata(recording), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    with writing(path) as temporary:
        pq.write_table(
            table.replace_schema_metadata({_KEY: text.encode()}),
            temporary,
            compression="zstd",
            use_dictionary=list(columns),  # values of the others hardly repeat
        )
    return replace(recording, path=path)


def _metadata(recording: Recording) -> dict[str, Any]:
    agents = recording.agents
    return {
        "format": FORMAT,
        "origin": asdict(recording.origin),
        "step_s": recording.step_s,
        "duration_s": recording.duration_s,
        "frames": recording.frames,
        "achieved": {
            "vehicles_per_lane_km": recording.vehicles_per_lane_km,
            "pedestrians_per_sidewalk_km": recording.pedestrians_per_sidewalk_km,
        },
        "free_flow_mps": recording.free_flow_mps,
        "remarks": recording.remarks,
        "removals": recording.removals,
        "signals": recording.signals,
        "agents": {
            "id": agents.id,
            "class": [agents.agent_class(i).value for i in range(len(agents))],
            "kind": agents.kind,
            **{name: [round(float(value), 3) for value in getattr(agents, name)] for name in _SIZES},
        },
    }


def load_recording(path: str | Path, world: World | None = None) -> Recording:
    """Read a recording, and check that it was made for `world` where one is given.

    Raises:
        PaveTwinError: there is no such file, it is not a recording of ours, or it belongs to another world.
    """
    path = Path(path)
    if not path.is_file():
        raise PaveTwinError(f"There is no recording '{path}'; make one with `pavetwin traffic record`.")
    try:
        table = pq.read_table(path)
        metadata = json.loads((table.schema.metadata or {})[_KEY])
        if metadata["format"] != FORMAT:
            raise PaveTwinError(
                f"The recording '{path}' has format {metadata['format']}, this version reads {FORMAT}; record it again."
            )
        recording = _recording(table, metadata, path)
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise PaveTwinError(f"'{path}' is not a complete recording of PaveTwin; record it again.") from error
    if world is not None and recording.origin.world != world.content_hash:
        raise PaveTwinError(
            f"The recording '{path}' was made for another world than '{world.name}'; record it again with "
            "`pavetwin traffic record`."
        )
    return recording


def _recording(table: pa.Table, metadata: dict[str, Any], path: Path) -> Recording:
    origin, who = metadata["origin"], metadata["agents"]
    asked = Density(**origin["asked"]) if origin["asked"] else None
    step = table["step"].to_numpy()
    offsets = np.searchsorted(step, np.arange(metadata["frames"] + 1)).astype(np.uint32)
    return Recording(
        origin=Origin(**{**origin, "asked": asked, "capacity": Capacity(**origin["capacity"])}),
        step_s=metadata["step_s"],
        agents=Agents(
            id=tuple(who["id"]),
            kind=tuple(who["kind"]),
            is_pedestrian=np.array([name == AgentClass.PEDESTRIAN for name in who["class"]], dtype=np.bool_),
            **{name: np.array(who[name], dtype=np.float32) for name in _SIZES},
        ),
        step_offsets=offsets,
        agent=table["agent"].to_numpy().astype(np.uint32),
        removals=tuple((int(step), int(count)) for step, count in metadata["removals"]),
        signals={name: tuple((int(s), str(t)) for s, t in states) for name, states in metadata["signals"].items()},
        path=path,
        free_flow_mps=metadata.get("free_flow_mps"),
        **{name: table[name].to_numpy() for name in _COLUMNS},
    )
