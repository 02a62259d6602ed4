"""Traffic without agents, for flights that are planned and not flown over anybody."""

from typing import Final

import numpy as np

from pavetwin._core import Trace

_FIRST_S: Final = 3600.0
_STEP_S: Final = 60.0


class EmptyStreets:
    """As long as it is asked for."""

    def __init__(self) -> None:
        self.duration_s = _FIRST_S

    def trace(self) -> Trace:
        nothing, none = np.empty(0, dtype=np.float32), np.empty(0, dtype=np.uint32)
        steps = round(self.duration_s / _STEP_S) + 1
        return Trace(
            step_s=_STEP_S,
            step_offsets=np.zeros(steps + 1, dtype=np.uint32),
            agent=none,
            x_m=nothing,
            y_m=nothing,
            yaw_rad=nothing,
            speed_mps=nothing,
            length_m=nothing,
            width_m=nothing,
            height_m=nothing,
            base_m=nothing,
            is_pedestrian=np.empty(0, dtype=np.bool_),
        )

    def extend(self, needed_s: float) -> Trace:
        self.duration_s = 2 * max(self.duration_s, needed_s)
        return self.trace()
