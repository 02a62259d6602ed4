"""The file of a recording: one Parquet table of key frames (see `part_table`), its parts as row groups.

Everything else is JSON in the file's metadata under the key `pavetwin`. The same recording gives the same bytes.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import Capacity, Density
from pavetwin.traffic.kinds import AgentClass
from pavetwin.traffic.part_file import from_arrow, part_writer, read_part, write_part
from pavetwin.traffic.pose_rows import COLUMNS, PoseRows
from pavetwin.traffic.recording import SIZES, Agents, Origin, Recording
from pavetwin.traffic.track_part import TrackPart
from pavetwin.traffic.tracks import AgentTracks, FrameNumbers, StoredPart
from pavetwin.world.model import World

FORMAT: Final = 3
"""Version of the file. The first one, a row for every pose, is still read, and its poses are rounded."""

_KEY: Final = "pavetwin"


def save_recording(recording: Recording, path: str | Path) -> Recording:
    """Write the recording to `path`, whole or not at all; returns it with its path.

    Raises:
        PaveTwinError: the file cannot be written.
    """
    path = Path(path)
    if recording.tracks.first_step or recording.tracks.parts[-1].last_step >= recording.frames:
        recording = replace(recording, tracks=recording.tracks.copied(recording.agents.is_pedestrian, recording.step_s))
    text = json.dumps(_metadata(recording), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    with writing(path) as temporary, part_writer(temporary) as writer:
        for part in recording.tracks.parts:
            write_part(writer, part.load())
        writer.add_key_value_metadata({_KEY: text})
    return replace(recording, path=path)


def _metadata(recording: Recording) -> dict[str, Any]:
    agents, tracks = recording.agents, recording.tracks
    return {
        "format": FORMAT,
        "origin": _origin(recording.origin),
        "step_s": recording.step_s,
        "duration_s": recording.duration_s,
        "frames": recording.frames,
        "achieved": {
            "vehicles_per_lane_km": recording.vehicles_per_lane_km,
            "pedestrians_per_sidewalk_km": recording.pedestrians_per_sidewalk_km,
        },
        "free_flow_mps": recording.free_flow_mps,
        "at_limits": None if recording.at_limits is None else recording.at_limits.tolist(),
        "remarks": recording.remarks,
        "removals": recording.removals,
        "signals": recording.signals,
        "numbers": {each.name: getattr(tracks.numbers, each.name).tolist() for each in fields(tracks.numbers)},
        "fastest_mps": tracks.fastest_mps,
        "parts": [(part.first_step, part.last_step) for part in tracks.parts],
        "agents": {
            "id": agents.id,
            "class": [agents.agent_class(i).value for i in range(len(agents))],
            "kind": agents.kind,
            **{name: [round(float(value), 3) for value in getattr(agents, name)] for name in SIZES},
        },
    }


def _origin(origin: Origin) -> dict[str, Any]:
    values = asdict(origin)
    return values if origin.area is not None else {key: value for key, value in values.items() if key != "area"}


def load_recording(path: str | Path, world: World | None = None) -> Recording:
    """Open a recording, and check that it was made for `world` where one is given. Its parts are read when they are
    needed; a part that is then found damaged is a `PaveTwinError`, too.

    Raises:
        PaveTwinError: there is no such file, it is not a recording of ours, or it belongs to another world.
    """
    path = Path(path)
    if not path.is_file():
        raise PaveTwinError(f"There is no recording '{path}'; make one with `pavetwin traffic record`.")
    try:
        file = pq.ParquetFile(path)
        metadata = json.loads((file.metadata.metadata or {})[_KEY.encode()])
        if metadata["format"] not in (1, FORMAT):
            raise PaveTwinError(
                f"The recording '{path}' has format {metadata['format']}, this version reads {FORMAT}; record it again."
            )
        recording = _recording(file, metadata, path)
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise PaveTwinError(f"'{path}' is not a complete recording of PaveTwin; record it again.") from error
    if world is not None and recording.origin.world != world.content_hash:
        raise PaveTwinError(
            f"The recording '{path}' was made for another world than '{world.name}'; record it again with "
            "`pavetwin traffic record`."
        )
    return recording


def _recording(file: pq.ParquetFile, metadata: dict[str, Any], path: Path) -> Recording:
    origin, who = metadata["origin"], metadata["agents"]
    asked = Density(**origin["asked"]) if origin["asked"] else None
    place = origin.get("area")
    area = TrafficArea(place["distance_m"], tuple(place["edges"])) if place else None
    agents = Agents(
        id=tuple(who["id"]),
        kind=tuple(who["kind"]),
        is_pedestrian=np.array([name == AgentClass.PEDESTRIAN for name in who["class"]], dtype=np.bool_),
        **{name: np.array(who[name], dtype=np.float32) for name in SIZES},
    )
    recording = Recording(
        origin=Origin(**{**origin, "asked": asked, "area": area, "capacity": Capacity(**origin["capacity"])}),
        step_s=metadata["step_s"],
        agents=agents,
        tracks=(_tracks if metadata["format"] == FORMAT else _tracks_of_all_rows)(file, metadata, agents, path),
        removals=tuple((int(step), int(count)) for step, count in metadata["removals"]),
        signals={name: tuple((int(s), str(t)) for s, t in states) for name, states in metadata["signals"].items()},
        path=path,
    )
    limits = metadata.get("at_limits")
    return recording if limits is None else replace(recording, at_limits=np.array(limits, float).reshape(-1, 2))


def _tracks(file: pq.ParquetFile, metadata: dict[str, Any], agents: Agents, path: Path) -> AgentTracks:  # noqa: ARG001
    steps = metadata["parts"]
    if len(steps) != file.metadata.num_row_groups:
        raise ValueError(f"{file.metadata.num_row_groups} row groups for {len(steps)} parts")
    parts = [
        StoredPart(first, last, _reader(file, number, first, last, path)) for number, (first, last) in enumerate(steps)
    ]
    given = metadata["numbers"]
    vehicles, pedestrians, known, standing = (
        np.array(given[name], np.int64) for name in ("vehicles", "pedestrians", "known", "standing")
    )
    numbers = FrameNumbers(vehicles, pedestrians, known, standing, np.array(given["speed_mps"], np.float64))
    return AgentTracks(tuple(parts), 0, numbers, metadata["fastest_mps"])


def _reader(file: pq.ParquetFile, group: int, first: int, last: int, path: Path) -> Callable[[], TrackPart]:
    def read() -> TrackPart:
        try:
            return read_part(file, group, first, last)
        except (pa.ArrowException, OSError, KeyError, ValueError) as error:
            raise PaveTwinError(f"The recording '{path}' is damaged; record it again.") from error

    return read


def _tracks_of_all_rows(file: pq.ParquetFile, metadata: dict[str, Any], agents: Agents, path: Path) -> AgentTracks:  # noqa: ARG001
    """Of a file of the first version."""
    table = file.read()
    offsets = np.searchsorted(from_arrow(table["step"]), np.arange(metadata["frames"] + 1)).astype(np.uint32)
    columns = {name: from_arrow(table[name]) for name in COLUMNS}
    rows = PoseRows(offsets, from_arrow(table["agent"]).astype(np.uint32), **columns)
    return AgentTracks.of(rows, agents.is_pedestrian, metadata["step_s"])
