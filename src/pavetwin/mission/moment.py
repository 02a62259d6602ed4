"""The kernel's view of one moment, behind the protocol that snapshots know."""

from typing import TYPE_CHECKING

import numpy as np

from pavetwin._core import DisplacementPredictor, Trace
from pavetwin.arrays import Float64Array
from pavetwin.twin import Agent, AgentClass

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns


class KernelMoment:
    """Asks the kernel for what a snapshot does not hold ready. Immutable, like all it refers to."""

    def __init__(self, predictor: DisplacementPredictor | None, time_s: float, trace: Trace) -> None:
        self._predictor = predictor
        self._time_s = time_s
        self._trace = trace

    def agents(self) -> tuple[Agent, ...]:
        return agents_of(self._trace.agents_at(self._time_s))

    def predict(self, displacements: Float64Array) -> Float64Array:
        if self._predictor is None:  # nothing is under inspection, so nothing is hidden
            return np.zeros(len(displacements))
        return self._predictor.predict(displacements)


def agents_of(columns: "PoseColumns") -> tuple[Agent, ...]:
    """Agents as values, from one array a column."""
    return tuple(
        Agent(
            id=int(columns["agent"][row]),
            kind=AgentClass.PEDESTRIAN if columns["is_pedestrian"][row] else AgentClass.VEHICLE,
            position=(float(columns["x_m"][row]), float(columns["y_m"][row])),
            velocity_mps=(float(columns["east_mps"][row]), float(columns["north_mps"][row])),
            yaw_rad=float(columns["yaw_rad"][row]),
            length_m=float(columns["length_m"][row]),
            width_m=float(columns["width_m"][row]),
            height_m=float(columns["height_m"][row]),
        )
        for row in range(len(columns["agent"]))
    )
