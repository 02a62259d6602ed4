"""Other aircraft: given by the user as tracks, flown beside the recorded traffic, kept clear of by the UAV."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError

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
    if missing and (separator := next((each for each in ";\t|" if each in "".join(table.columns)), "")):
        shown = "tabs" if separator == "\t" else f"'{separator}'"
        raise PaveTwinError(
            f"The airspace '{path}' is separated by {shown}; save it separated by commas, with points in numbers: "
            f"{','.join(COLUMNS)}."
        )
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


def with_aircraft(columns: Mapping[str, Any], aircraft: Sequence[Aircraft]) -> Mapping[str, Any]:
    """`trace_arguments` with the aircraft before what moves on the ground, so that extending keeps the numbering."""
    if not aircraft:
        return columns
    offsets, count = columns["step_offsets"], len(aircraft)
    air = [_rows(number, craft, len(offsets) - 1, columns["step_s"]) for number, craft in enumerate(aircraft)]
    ground = {
        **columns,
        "step": np.repeat(np.arange(len(offsets) - 1), np.diff(offsets)),
        "agent": columns["agent"] + count,
    }
    rows = {name: np.concatenate([*(craft[name] for craft in air), ground[name]]) for name in air[0]}
    order = np.lexsort((rows["agent"], rows["step"]))
    altitude_m, span_m = np.array([craft.altitude_m for craft in aircraft]), np.full(count, SPAN_M)
    bodies = {
        "length_m": span_m,
        "width_m": span_m,
        "height_m": altitude_m + HALF_HEIGHT_M,
        "base_m": np.maximum(altitude_m - HALF_HEIGHT_M, 0.0),
        "is_pedestrian": np.zeros(count),
    }
    return {
        "step_s": columns["step_s"],
        "step_offsets": np.searchsorted(rows.pop("step")[order], np.arange(len(offsets))).astype(np.uint32),
        **{name: values[order].astype(columns[name].dtype) for name, values in rows.items()},
        **{name: np.append(values.astype(columns[name].dtype), columns[name]) for name, values in bodies.items()},
    }


def _rows(number: int, craft: Aircraft, frames: int, step_s: float) -> dict[str, Any]:
    """The aircraft at every step of the recording that its track covers."""
    times = np.arange(frames) * step_s
    step = np.flatnonzero((times >= craft.t_s[0]) & (times <= craft.t_s[-1]))
    at = times[step]
    x_m, y_m = (np.interp(at, craft.t_s, craft.xy_m[:, axis]) for axis in (0, 1))
    leg = np.clip(np.searchsorted(craft.t_s, at, side="right") - 1, 0, len(craft.t_s) - 2)
    east, north = (np.diff(craft.xy_m, axis=0)[leg] / np.diff(craft.t_s)[leg, None]).T
    agent, yaw_rad = np.full(len(step), number), np.arctan2(north, east)
    columns = {"step": step, "agent": agent, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad}
    return {**columns, "speed_mps": np.hypot(east, north)}
