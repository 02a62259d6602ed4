"""A recording as a trace of the kernel, which interpolates between its frames."""

from typing import TypedDict

import numpy as np

from pavetwin._core import Trace
from pavetwin.arrays import BoolArray, Float32Array, UInt32Array
from pavetwin.traffic.recording import Recording


class TraceArguments(TypedDict):
    """The arguments of the kernel's `Trace`: (steps + 1,), (rows,) and (agents,) arrays, as in `Recording`."""

    step_s: float
    step_offsets: UInt32Array
    agent: UInt32Array
    x_m: Float32Array
    y_m: Float32Array
    yaw_rad: Float32Array
    speed_mps: Float32Array
    length_m: Float32Array
    width_m: Float32Array
    height_m: Float32Array
    base_m: Float32Array
    is_pedestrian: BoolArray


def trace_arguments(recording: Recording) -> TraceArguments:
    """The arguments of the kernel's trace, with every agent on the ground."""
    agents = recording.agents
    return TraceArguments(
        step_s=recording.step_s,
        step_offsets=recording.step_offsets,
        agent=recording.agent,
        x_m=recording.x,
        y_m=recording.y,
        yaw_rad=recording.yaw_rad,
        speed_mps=recording.speed_mps,
        length_m=agents.length_m,
        width_m=agents.width_m,
        height_m=agents.height_m,
        base_m=np.zeros_like(agents.height_m),
        is_pedestrian=agents.is_pedestrian,
    )


def trace_of(recording: Recording) -> Trace:
    """The kernel's trace of a recording's agents."""
    return Trace(**trace_arguments(recording))
