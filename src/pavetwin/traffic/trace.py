"""A recording as a trace of the kernel, which reads its parts when the clock reaches them."""

from collections.abc import Callable
from typing import Final, TypedDict, cast

import numpy as np

from pavetwin._core import Trace
from pavetwin.arrays import BoolArray, Float32Array, UInt32Array
from pavetwin.traffic.recording import Recording

_POSE: Final = ("x_m", "y_m", "yaw_rad", "speed_mps")


class KeyFrameColumns(TypedDict):
    """A part as the kernel takes it; see `TrackPart`."""

    first_step: int
    last_step: int
    agent: UInt32Array
    step: UInt32Array
    x_m: Float32Array
    y_m: Float32Array
    yaw_rad: Float32Array
    speed_mps: Float32Array
    is_last: BoolArray


class TraceArguments(TypedDict):
    """The arguments of the kernel's `Trace.of_parts`."""

    read: Callable[[int], KeyFrameColumns]
    step_s: float
    first_step: int
    step_count: int
    starts: list[int]
    max_speed_mps: float
    length_m: Float32Array
    width_m: Float32Array
    height_m: Float32Array
    base_m: Float32Array
    is_pedestrian: BoolArray


def trace_arguments(recording: Recording) -> TraceArguments:
    """A recording for the kernel, with every agent on the ground."""
    agents, tracks = recording.agents, recording.tracks
    last_step = tracks.first_step + tracks.frames - 1

    def read(number: int) -> KeyFrameColumns:
        part = tracks.parts[number].load()
        known = np.searchsorted(part.agent, len(agents))  # a longer recording's part may hold more than these
        columns = {name: getattr(part, name)[:known] for name in ("agent", "step", "is_last")}
        pose = {name: column[:known] for name, column in zip(_POSE, part.poses(), strict=True)}
        return cast("KeyFrameColumns", {"first_step": part.first_step, "last_step": part.last_step, **columns, **pose})

    return TraceArguments(
        read=read,
        step_s=recording.step_s,
        first_step=tracks.first_step,
        step_count=tracks.frames,
        starts=[start for start in tracks.starts if start == 0 or start < last_step],
        max_speed_mps=tracks.fastest_mps,
        length_m=agents.length_m,
        width_m=agents.width_m,
        height_m=agents.height_m,
        base_m=np.zeros_like(agents.height_m),
        is_pedestrian=agents.is_pedestrian,
    )


def trace_of(recording: Recording) -> Trace:
    """The kernel's trace of a recording's agents."""
    return Trace.of_parts(**trace_arguments(recording))
