"""A stretch of a recording as floating car data: a row for each agent and moment, as tools for SUMO's traces read it.

Columns as in SUMO's `fcd-output` (`time`, `id`, `type`, `x`, `y`, `angle`, `speed`), then `class` and the body's sizes.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from math import ceil, floor
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.traffic.kinds import AgentClass
from pavetwin.traffic.pose_rows import PoseRows
from pavetwin.traffic.recording import SIZES, Recording

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
