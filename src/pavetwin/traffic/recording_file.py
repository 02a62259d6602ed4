"""The file of a recording, and its export as floating car data.

The file is one Parquet table of key frames (see `tracks`), its parts as row groups. Everything else is JSON in the
file's metadata under the key `pavetwin`. The same recording gives the same bytes.

Floating car data has a row for each agent and moment, as tools for SUMO's traces read it. Columns as in SUMO's
`fcd-output` (`time`, `id`, `type`, `x`, `y`, `angle`, `speed`), then `class` and the body's sizes.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict, fields, replace
from math import ceil, floor
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, writing
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import Capacity, Density
from pavetwin.traffic.kinds import AgentClass
from pavetwin.traffic.recording import SIZES, Agents, Origin, Recording
from pavetwin.traffic.tracks import (
    AgentTracks,
    FrameNumbers,
    PoseRows,
    StoredPart,
    TrackPart,
    part_writer,
    read_part,
    write_part,
)
from pavetwin.world.model import World

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
        "origin": asdict(recording.origin),
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
        check_format(metadata["format"], f"The recording '{path}'")
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
    place, limits = origin["area"], metadata["at_limits"]
    area = TrafficArea(place["distance_m"], tuple(place["edges"])) if place else None
    agents = Agents(
        id=tuple(who["id"]),
        kind=tuple(who["kind"]),
        is_pedestrian=np.array([name == AgentClass.PEDESTRIAN for name in who["class"]], dtype=np.bool_),
        **{name: np.array(who[name], dtype=np.float32) for name in SIZES},
    )
    return Recording(
        origin=Origin(**{**origin, "asked": asked, "area": area, "capacity": Capacity(**origin["capacity"])}),
        step_s=metadata["step_s"],
        agents=agents,
        tracks=_tracks(file, metadata, path),
        removals=tuple((int(step), int(count)) for step, count in metadata["removals"]),
        signals={name: tuple((int(s), str(t)) for s, t in states) for name, states in metadata["signals"].items()},
        path=path,
        at_limits=None if limits is None else np.array(limits, float).reshape(-1, 2),
    )


def _tracks(file: pq.ParquetFile, metadata: dict[str, Any], path: Path) -> AgentTracks:
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


SCHEMA: Final = pa.schema(
    [
        ("time", pa.float64()),
        ("id", pa.string()),
        ("type", pa.string()),
        ("x", pa.float64()),
        ("y", pa.float64()),
        ("angle", pa.float64()),
        ("speed", pa.float64()),
        ("class", pa.string()),
        *((name, pa.float32()) for name in SIZES),
    ]
)
"""Seconds of the recording; metres of the world's frame: of a vehicle the middle of its front bumper, of a person the
centre; degrees clockwise from north; metres per second."""

WRITERS: Final[Mapping[str, Callable[..., AbstractContextManager[Any]]]] = {
    ".parquet": lambda path: pq.ParquetWriter(path, SCHEMA, compression="zstd"),
    ".csv": lambda path: pyarrow.csv.CSVWriter(path, SCHEMA),
}


def export_fcd(
    recording: Recording,
    target: str | Path,
    start_s: float = 0.0,
    end_s: float | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> int:
    """Write the poses at the moments from `start_s` to `end_s`, both included, to a `.parquet` or `.csv` file, whole or
    not at all.

    Parts of the recording are read one after another, so memory does not grow with its length.

    Args:
        end_s: the recording's end unless given.

    Returns:
        The number of rows.

    Raises:
        PaveTwinError: the recording does not hold the stretch or a moment of it, is damaged, or is the file itself, or
            the file cannot be written.
    """
    target, last_s = Path(target), recording.duration_s if end_s is None else end_s
    if target.suffix not in WRITERS:
        raise PaveTwinError(f"`target` {target}: the file's name must end in {' or '.join(WRITERS)}.")
    if not 0 <= start_s <= last_s <= recording.duration_s:
        raise PaveTwinError(
            f"The recording lasts from 0 to {recording.duration_s:g} s; a stretch from {start_s:g} to {last_s:g} s is "
            "not in it."
        )
    if recording.path is not None and target.exists() and target.samefile(recording.path):
        raise PaveTwinError(
            f"`target` {target}: it is the recording itself, which this would replace; give another name."
        )
    first_frame, last_frame = ceil(start_s / recording.step_s - 1e-9), floor(last_s / recording.step_s + 1e-9)
    if first_frame > last_frame:
        raise PaveTwinError(
            f"No moment of the recording lies from {start_s:g} to {last_s:g} s: it has one every "
            f"{recording.step_s:g} s."
        )
    begin_s = first_frame * recording.step_s
    stretch = recording.until(max(last_frame, 1) * recording.step_s).after(begin_s)
    count, frames = 0, last_frame - first_frame + 1
    with writing(target) as temporary, WRITERS[target.suffix](temporary) as writer:
        for first, rows in _up_to(stretch.tracks.pieces(), frames):
            table = _table(stretch, rows, begin_s + first * recording.step_s)
            writer.write_table(table)
            count += len(table)
            if on_progress is not None:
                on_progress((first + rows.frames) / frames)
    return count


def _up_to(pieces: Iterator[tuple[int, PoseRows]], frames: int) -> Iterator[tuple[int, PoseRows]]:
    for first, rows in pieces:
        if first < frames:
            yield first, rows.between(0, min(rows.frames, frames - first))


def _table(recording: Recording, rows: PoseRows, begin_s: float) -> pa.Table:
    agents, agent, yaw = recording.agents, rows.agent, rows.yaw_rad.astype(np.float64)
    ahead_m = np.where(agents.is_pedestrian[agent], 0.0, agents.length_m[agent] / 2)
    classes = [each.value for each in (AgentClass.VEHICLE, AgentClass.PEDESTRIAN)]
    columns = {
        "time": begin_s + rows.frame * recording.step_s,
        "id": pa.array(agents.id).take(pa.array(agent)),
        "type": pa.array(agents.kind).take(pa.array(agent)),
        "x": np.round(rows.x + ahead_m * np.cos(yaw), 3),
        "y": np.round(rows.y + ahead_m * np.sin(yaw), 3),
        "angle": np.round(90.0 - np.degrees(yaw), 3) % 360.0,
        "speed": np.round(rows.speed_mps.astype(np.float64), 3),
        "class": pa.array(classes).take(pa.array(agents.is_pedestrian[agent].astype(np.int8))),
        **{name: getattr(agents, name)[agent] for name in SIZES},
    }
    return pa.table(columns, schema=SCHEMA)
