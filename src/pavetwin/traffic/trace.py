"""A recording in the kernel's hands, which alone interpolates between its frames."""

from typing import TypedDict

import numpy as np

from pavetwin._core import Trace
from pavetwin.arrays import BoolArray, Float32Array, UInt32Array
from pavetwin.traffic.recording import Recording


class TraceArguments(TypedDict):
    """What the kernel's trace is made of."""

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
    """A recording as the kernel wants it, everyone on the ground."""
    columns = recording.columns()
    return TraceArguments(
        step_s=columns["step_s"],
        step_offsets=columns["step_offsets"],
        agent=columns["agent"],
        x_m=columns["x"],
        y_m=columns["y"],
        yaw_rad=columns["yaw_rad"],
        speed_mps=columns["speed_mps"],
        length_m=columns["length_m"],
        width_m=columns["width_m"],
        height_m=columns["height_m"],
        base_m=np.zeros_like(columns["height_m"]),
        is_pedestrian=columns["is_pedestrian"],
    )


def trace_of(recording: Recording) -> Trace:
    """The kernel's trace of a recording and no one else."""
    return Trace(**trace_arguments(recording))
