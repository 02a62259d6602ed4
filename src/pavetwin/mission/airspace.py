"""Other aircraft: tracks given by the user, flown above the recorded traffic. The UAV keeps clear of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import polars as pl

from pavetwin.arrays import AnyArray, Float64Array, Int64Array
from pavetwin.errors import PaveTwinError
from pavetwin.traffic.trace import KeyFrameColumns, TraceArguments

COLUMNS = ("aircraft", "t_s", "x_m", "y_m", "altitude_m")

SPAN_M = 0.6
"""Width and length assumed for every other aircraft: a small quadrotor with its rotors."""

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
        PaveTwinError: it cannot be read, a column is missing, or a track is invalid.
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
        raise PaveTwinError(f"The airspace '{path}' has no {', '.join(missing)}; it needs {', '.join(COLUMNS)}.")
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


def with_aircraft(ground: TraceArguments, aircraft: Sequence[Aircraft]) -> TraceArguments:
    """`trace_arguments` with the aircraft before the agents on the ground, so that extending keeps the numbering."""
    if not aircraft:
        return ground
    count = len(aircraft)
    first, last = ground["first_step"], ground["first_step"] + ground["step_count"] - 1

    def read(number: int) -> KeyFrameColumns:
        part = ground["read"](number)
        steps = np.arange(max(part["first_step"], first), min(part["last_step"], last) + 1)
        air = [_key_frames(number, craft, steps, first, ground["step_s"]) for number, craft in enumerate(aircraft)]
        below = {**part, "agent": part["agent"] + np.uint32(count)}
        columns = {name: np.concatenate([*(craft[name] for craft in air), below[name]]) for name in air[0]}
        return cast("KeyFrameColumns", {**below, **columns})

    altitude_m, span_m = np.array([craft.altitude_m for craft in aircraft]), np.full(count, SPAN_M)
    bodies = {
        "length_m": span_m,
        "width_m": span_m,
        "height_m": altitude_m + HALF_HEIGHT_M,
        "base_m": np.maximum(altitude_m - HALF_HEIGHT_M, 0.0),
        "is_pedestrian": np.zeros(count),
    }
    given = cast("Mapping[str, AnyArray]", ground)
    both = {name: np.append(values.astype(given[name].dtype), given[name]) for name, values in bodies.items()}
    fastest = max(float(np.hypot(*_velocities(craft)).max()) for craft in aircraft)
    speeds = {"read": read, "max_speed_mps": max(ground["max_speed_mps"], fastest)}
    return cast("TraceArguments", {**ground, **both, **speeds})


def _key_frames(
    number: int, craft: Aircraft, steps: Int64Array, first_step: int, step_s: float
) -> Mapping[str, AnyArray]:
    """Poses of an aircraft at the steps of a recording that its track covers; its time starts at the first step."""
    times = (steps - first_step) * step_s
    covered = (times >= craft.t_s[0]) & (times <= craft.t_s[-1])
    at = times[covered]
    leg = np.clip(np.searchsorted(craft.t_s, at, side="right") - 1, 0, len(craft.t_s) - 2)
    east, north = _velocities(craft)[:, leg]
    x_m, y_m = (np.interp(at, craft.t_s, craft.xy_m[:, axis]) for axis in (0, 1))
    poses = {"x_m": x_m, "y_m": y_m, "yaw_rad": np.arctan2(north, east), "speed_mps": np.hypot(east, north)}
    return {
        "agent": np.full(len(at), number, dtype=np.uint32),
        "step": steps[covered].astype(np.uint32),
        "is_last": np.zeros(len(at), dtype=np.bool_),
        **{name: values.astype(np.float32) for name, values in poses.items()},
    }


def _velocities(craft: Aircraft) -> Float64Array:
    """(2, legs) east and north, in m/s."""
    velocities: Float64Array = (np.diff(craft.xy_m, axis=0) / np.diff(craft.t_s)[:, None]).T
    return velocities
