"""A recording as a trace of the kernel, which interpolates between its frames."""

from typing import Any

import numpy as np

from pavetwin._core import Trace
from pavetwin.traffic.recording import Recording


def trace_arguments(recording: Recording) -> dict[str, Any]:
    """The arguments of the kernel's `Trace`: arrays as in `Recording` and `Agents`, with every agent on the ground."""
    agents = recording.agents
    return {
        "step_s": recording.step_s,
        "step_offsets": recording.step_offsets,
        "agent": recording.agent,
        "x_m": recording.x,
        "y_m": recording.y,
        "yaw_rad": recording.yaw_rad,
        "speed_mps": recording.speed_mps,
        **{name: getattr(agents, name) for name in ("length_m", "width_m", "height_m", "is_pedestrian")},
        "base_m": np.zeros_like(agents.height_m),
    }


def trace_of(recording: Recording) -> Trace:
    """The kernel's trace of a recording's agents."""
    return Trace(**trace_arguments(recording))
