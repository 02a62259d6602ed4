"""From SUMO's floating-car data to a recording.

SUMO gives a vehicle's front bumper and a heading in degrees clockwise from north; a recording holds the body's centre
on the ground and a yaw in radians counter-clockwise from east.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import polars as pl

from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.recording import Agents, Origin, Recording
from pavetwin.traffic.sumo_run import STEP_S, Outcome

Floats = npt.NDArray[np.float64]

_SCHEMA = {
    "time": pl.Float64,
    "id": pl.String,
    "x": pl.Float64,
    "y": pl.Float64,
    "angle": pl.Float64,
    "speed": pl.Float64,
}


def yaw_of_heading(heading_deg: npt.ArrayLike) -> Floats:
    """Degrees clockwise from north to radians counter-clockwise from east, in −π … π."""
    turned = np.radians(90.0 - np.asarray(heading_deg, dtype=np.float64))
    yaw: Floats = np.arctan2(np.sin(turned), np.cos(turned))
    return yaw


def centre_of_front(front: npt.ArrayLike, yaw_rad: npt.ArrayLike, length_m: npt.ArrayLike) -> Floats:
    """The centres (..., 2) of bodies whose front bumpers' middles are `front` (..., 2), in metres."""
    yaw, half = np.asarray(yaw_rad, dtype=np.float64), np.asarray(length_m, dtype=np.float64)[..., np.newaxis] / 2
    centre: Floats = np.asarray(front, dtype=np.float64) - half * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    return centre


def to_recording(folder: Path, outcome: Outcome, origin: Origin, frames: int) -> Recording:
    """The recording of a finished run, whose files lie in `folder`.

    Only what is on the streets is in it: SUMO writes no vehicle that is teleported or waits to depart, and a person who
    rides in a vehicle (a user's own demand) is left out.

    Raises:
        PaveTwinError: SUMO's files are not whole.
    """
    try:
        vehicles = _read(folder / "vehicles.parquet", "vehicle", outcome.start_s, frames)
        persons = _read(folder / "persons.parquet", "person", outcome.start_s, frames)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise PaveTwinError(
            f"SUMO's output in '{folder.parent}' is not whole; the disk may be full. Free some space, or name another "
            "place by TMPDIR."
        ) from error
    persons = persons.join(vehicles.select("step", "x", "y"), on=["step", "x", "y"], how="anti")
    rows = pl.concat([vehicles.with_columns(walks=False), persons.with_columns(walks=True)])
    order = rows.group_by("walks", "id").agg(pl.col("step").min()).sort("step", "walks", "id")
    agents = _agents(order, outcome, origin.seed)
    rows = rows.join(order.select("walks", "id").with_row_index("agent"), on=["walks", "id"]).sort("step", "agent")
    agent = rows["agent"].to_numpy()
    yaw = yaw_of_heading(rows["angle"].to_numpy())
    centre = centre_of_front(rows.select("x", "y").to_numpy(), yaw, agents.length_m[agent])
    return Recording(
        origin=origin,
        step_s=STEP_S,
        agents=agents,
        step_offsets=np.searchsorted(rows["step"].to_numpy(), np.arange(frames + 1)).astype(np.uint32),
        agent=agent,
        x=centre[:, 0].astype(np.float32),
        y=centre[:, 1].astype(np.float32),
        yaw_rad=yaw.astype(np.float32),
        speed_mps=rows["speed"].to_numpy().astype(np.float32),
        removals=tuple((step, count) for step, count in outcome.removals),
        signals={name: tuple((step, state) for step, state in states) for name, states in outcome.signals.items()},
    )


def _read(path: Path, what: str, start_s: float, frames: int) -> pl.DataFrame:
    """Rows of the recorded frames: step, id, x, y, angle, speed."""
    step = ((pl.col("time") - start_s) / STEP_S).round().cast(pl.Int32).alias("step")
    if not pl.read_parquet_schema(path):  # nobody of this class was on the streets: SUMO writes no columns
        return pl.DataFrame(schema=_SCHEMA).with_columns(step)
    return (
        pl.scan_parquet(path)
        .select(
            pl.col("timestep_time").alias("time"),
            *(pl.col(f"{what}_{name}").alias(name) for name in list(_SCHEMA)[1:]),
        )
        .filter(pl.col("id").is_not_null())
        .with_columns(step)
        .filter((pl.col("step") >= 0) & (pl.col("step") < frames))
        .collect()
    )


def _agents(order: pl.DataFrame, outcome: Outcome, seed: int) -> Agents:
    """The agents of the table `order` (walks, id), in its order."""
    rng = child(seed, Stream.TRAFFIC, 1)
    walks = order["walks"].to_numpy()
    bodies = {False: outcome.vehicles, True: outcome.persons}
    rows = [bodies[bool(walk)][name] for name, walk in zip(order["id"], walks, strict=True)]
    # Drawn in the order of first appearance, so that a longer recording begins with the same bodies.
    heights = [KINDS[kind].height_of_one(rng) if kind in KINDS else height for kind, _, _, height in rows]
    return Agents(
        id=tuple(order["id"].to_list()),
        kind=tuple(row[0] for row in rows),
        length_m=np.array([row[1] for row in rows], dtype=np.float32),
        width_m=np.array([row[2] for row in rows], dtype=np.float32),
        height_m=np.round(heights, 3).astype(np.float32),
        is_pedestrian=walks.astype(np.bool_),
    )
