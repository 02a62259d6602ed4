"""A recording in the kernel's hands, which alone interpolates between its frames."""

from typing import TypedDict

import numpy as np
import numpy.typing as npt

from pavetwin._core import Trace
from pavetwin.traffic.recording import Recording

Singles = npt.NDArray[np.float32]


class TraceArguments(TypedDict):
    """What the kernel's trace is made of."""

    step_s: float
    step_offsets: npt.NDArray[np.uint32]
    agent: npt.NDArray[np.uint32]
    x_m: Singles
    y_m: Singles
    yaw_rad: Singles
    speed_mps: Singles
    length_m: Singles
    width_m: Singles
    height_m: Singles
    base_m: Singles
    is_pedestrian: npt.NDArray[np.bool_]


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
