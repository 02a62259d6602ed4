"""D_t = (S, A_t, x_t, M_t, Π) at one moment, for policies and sensors."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array
from pavetwin.twin.state import Agent, InspectionMemory, Place, UavState
from pavetwin.world.model import Segment


@dataclass(frozen=True, slots=True)
class Episode:
    """The time since visibility fell below τ_o, while it has not recovered."""

    since_s: float
    waited_s: float = 0.0
    """Time waited in this episode so far."""
    displacements: int = 0
    since_displacement_m: float = float("inf")
    """Distance along the route since the last displacement of this episode."""


@dataclass(frozen=True, slots=True)
class Occlusion:
    """Visibility of the segment under inspection s*.

    Cells hidden by a building, a tree, street furniture or a parked vehicle do not count in `visibility`, since waiting
    does not reveal them.
    """

    visibility: float
    """o_{s*,t}."""
    hidden_place: Place | None
    """Centroid of the cells that moving agents hide; None if nothing is hidden."""
    episode: Episode
    permanently_hidden: float = 0.0
    """Share of the inspection window's cells that parked vehicles hide, of those that no building, tree or street
    furniture hides."""


class Moment(Protocol):
    """The kernel's view of one moment: it computes on request what a snapshot does not store."""

    def agents(self) -> Sequence[Agent]: ...

    def predict(self, displacements: Float64Array) -> Float64Array: ...


@dataclass(frozen=True)
class Snapshot:
    """The digital twin D_t. Immutable: it does not change when the mission continues."""

    time_s: float
    segments: Sequence[Segment]
    """S."""
    uav: UavState
    """x_t."""
    memory: InspectionMemory
    """M_t."""
    policy: str
    """Π."""
    segment: Segment | None
    """s*: the one under inspection."""
    occlusion: Occlusion | None
    """o_{s*,t}; None if nothing is under inspection."""
    window_along_m: float
    """Length of the inspection window along the track."""
    moment: Moment = field(repr=False)
    parked: Sequence[Agent] = field(default=(), repr=False)
    """The vehicles that stay parked during the whole mission; `agents` does not include them."""

    @cached_property
    def agents(self) -> Sequence[Agent]:
        """A_t: every moving agent in the world at this time, including those that stand in traffic."""
        return self.moment.agents()

    def predict_visibility(self, displacements: npt.ArrayLike) -> Float64Array:
        """Predicted share of the cells hidden now that would be visible after a displacement.

        The agents are moved on at their present velocities by the time the displacement takes.

        Args:
            displacements: (n, 2) east and north in metres.

        Returns:
            (n,) shares in [0, 1]; −1 for a displacement that would leave the flight domain.
        """
        return self.moment.predict(np.ascontiguousarray(displacements, dtype=np.float64).reshape(-1, 2))
