"""Other aircraft: given by the user as tracks, flown beside the recorded traffic, kept clear of by the UAV."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.traffic.trace import TraceArguments

COLUMNS = ("aircraft", "t_s", "x_m", "y_m", "altitude_m")

SPAN_M = 0.6
"""Width and length of another UAV where the file does not say: a small quadrotor with its rotors."""

HALF_HEIGHT_M = 0.2


@dataclass(frozen=True)
class Aircraft:
    """One aircraft's track at one altitude: at least two points, times rising."""

    name: str
    t_s: Float64Array
    xy_m: Float64Array
    """(n, 2), world frame."""
    altitude_m: float


def load_airspace(path: Path) -> tuple[Aircraft, ...]:
    """Read a CSV with the columns aircraft, t_s, x_m, y_m, altitude_m (world frame, mission time).

    Raises:
        PaveTwinError: it cannot be read, a column is missing, or a track is not one.
    """
    try:
        table = pl.read_csv(path)
    except OSError as error:
        raise PaveTwinError(f"The airspace '{path}' cannot be read: {error.strerror or error}.") from error
    except pl.exceptions.PolarsError as error:
        raise PaveTwinError(f"The airspace '{path}' is not a CSV table: {str(error).splitlines()[0]}.") from error
    missing = [name for name in COLUMNS if name not in table.columns]
    if missing:
        raise PaveTwinError(f"The airspace '{path}' lacks {', '.join(missing)}; it needs {', '.join(COLUMNS)}.")
    return tuple(_aircraft(str(key[0]), part, path) for key, part in table.group_by("aircraft", maintain_order=True))


def _aircraft(name: str, part: pl.DataFrame, path: Path) -> Aircraft:
    where = f"The airspace '{path}', aircraft '{name}'"
    try:
        numbers = part.select(pl.col(*COLUMNS[1:]).cast(pl.Float64)).to_numpy()
    except pl.exceptions.PolarsError as error:
        raise PaveTwinError(f"{where}: {', '.join(COLUMNS[1:])} must be numbers.") from error
    if len(numbers) < 2 or not np.isfinite(numbers).all() or not (np.diff(numbers[:, 0]) > 0).all():
        raise PaveTwinError(f"{where}: give at least two points with rising times.")
    if np.ptp(numbers[:, 3]) > 0:
        raise PaveTwinError(f"{where}: its altitude changes; give each level a name of its own.")
    return Aircraft(name, numbers[:, 0], numbers[:, 1:3], float(numbers[0, 3]))


def with_aircraft(columns: TraceArguments, aircraft: Sequence[Aircraft]) -> TraceArguments:
    """The trace of what moves on the ground, with the aircraft before it, so that extending it keeps the numbering."""
    if not aircraft:
        return columns
    offsets, step_s, count = columns["step_offsets"], columns["step_s"], len(aircraft)
    steps = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    air = [_rows(number, craft, len(offsets) - 1, step_s) for number, craft in enumerate(aircraft)]
    step = np.concatenate([*(rows["step"] for rows in air), steps])
    agent = np.concatenate([*(rows["agent"] for rows in air), columns["agent"] + count])
    order = np.lexsort((agent, step))

    def merged(name: str, values: Float32Array) -> Float32Array:
        return np.concatenate([*(rows[name] for rows in air), values]).astype(np.float32)[order]

    def sized(value: Sequence[float], values: Float32Array) -> Float32Array:
        return np.concatenate([np.asarray(value, dtype=np.float32), values])

    return TraceArguments(
        step_s=step_s,
        step_offsets=np.searchsorted(step[order], np.arange(len(offsets))).astype(np.uint32),
        agent=agent[order].astype(np.uint32),
        x_m=merged("x", columns["x_m"]),
        y_m=merged("y", columns["y_m"]),
        yaw_rad=merged("yaw", columns["yaw_rad"]),
        speed_mps=merged("speed", columns["speed_mps"]),
        length_m=sized([SPAN_M] * count, columns["length_m"]),
        width_m=sized([SPAN_M] * count, columns["width_m"]),
        height_m=sized([craft.altitude_m + HALF_HEIGHT_M for craft in aircraft], columns["height_m"]),
        base_m=sized([max(craft.altitude_m - HALF_HEIGHT_M, 0.0) for craft in aircraft], columns["base_m"]),
        is_pedestrian=np.concatenate([np.zeros(count, dtype=np.bool_), columns["is_pedestrian"]]),
    )


def _rows(number: int, craft: Aircraft, frames: int, step_s: float) -> dict[str, Float64Array]:
    """The aircraft at every step of the recording that its track covers."""
    times = np.arange(frames) * step_s
    step = np.flatnonzero((times >= craft.t_s[0]) & (times <= craft.t_s[-1]))
    at = times[step]
    x, y = (np.interp(at, craft.t_s, craft.xy_m[:, axis]) for axis in (0, 1))
    leg = np.clip(np.searchsorted(craft.t_s, at, side="right") - 1, 0, len(craft.t_s) - 2)
    move = np.diff(craft.xy_m, axis=0)[leg] / np.diff(craft.t_s)[leg, None]
    return {
        "step": step,
        "agent": np.full(len(step), number),
        "x": x,
        "y": y,
        "yaw": np.arctan2(move[:, 1], move[:, 0]),
        "speed": np.hypot(move[:, 0], move[:, 1]),
    }
