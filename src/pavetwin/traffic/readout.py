"""Reads the poses of all agents from the running simulation, in the simulation's process."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Final

import numpy as np

from pavetwin.traffic.job import Body
from pavetwin.traffic.kinds import kind_of_type

ACCESS_STAGE: Final = 4
"""SUMO's number for a stage between a street and a platform, on neither of which the person is."""


@dataclass
class Rows:
    """The frames since the last part, in the order of reading."""

    frame: "array[int]" = field(default_factory=lambda: array("I"))
    """How many rows each frame has."""
    agent: "array[int]" = field(default_factory=lambda: array("I"))
    xy: "array[float]" = field(default_factory=lambda: array("d"))
    heading_deg: "array[float]" = field(default_factory=lambda: array("d"))
    speed_mps: "array[float]" = field(default_factory=lambda: array("d"))
    bodies: list[Body] = field(default_factory=list)

    def columns(self) -> dict[str, Any]:
        """The arrays of a `Part`, rows sorted by (frame, agent), and the agents that are new in it."""
        rows, agent = np.array(self.frame, dtype=np.uint32), np.array(self.agent, dtype=np.uint32)
        order = np.lexsort((agent, np.repeat(np.arange(len(rows)), rows)))
        xy = np.array(self.xy).reshape(-1, 2)[order]
        heading, speed = np.array(self.heading_deg)[order], np.array(self.speed_mps)[order]
        columns = {"rows": rows, "agent": agent[order], "heading_deg": heading, "speed_mps": speed}
        return {**columns, "x": xy[:, 0], "y": xy[:, 1], "bodies": self.bodies}


class Readout:
    """Reads the running simulation `sumo` (the libsumo module), and numbers agents as they appear.

    Only agents on the streets are read: no vehicle that is teleported or waits to depart. With `riders` (a user's own
    demand), persons inside vehicles are skipped; without `pedestrians`, all persons are.
    """

    def __init__(self, sumo: Any, *, riders: bool, pedestrians: bool = True) -> None:
        self._sumo, self._riders, self._pedestrians = sumo, riders, pedestrians
        self._vehicles: dict[str, int] = {}
        self._persons: dict[str, int] = {}
        self._sizes: dict[str, tuple[str, float, float, float]] = {}
        self._rows = Rows()

    def read(self) -> None:
        """Read one frame."""
        sumo, before = self._sumo, len(self._rows.agent)
        self._read(sumo.vehicle, sumo.vehicle.getIDList(), self._vehicles)
        if self._pedestrians:
            persons = sumo.person.getIDList()
            self._read(sumo.person, self._on_foot(persons) if self._riders else persons, self._persons)
        self._rows.frame.append(len(self._rows.agent) - before)

    def take(self) -> Rows:
        """The frames since the last call."""
        rows, self._rows = self._rows, Rows()
        return rows

    def _read(self, domain: Any, names: Sequence[str], numbers: dict[str, int]) -> None:
        for name in sorted(set(names).difference(numbers)):
            numbers[name] = len(self._vehicles) + len(self._persons)
            self._rows.bodies.append(self._body(domain, name))
        rows = self._rows
        rows.agent.extend(map(numbers.__getitem__, names))
        rows.xy.extend(chain.from_iterable(map(_plain(self._sumo, domain, "getPosition"), names)))
        rows.heading_deg.extend(map(_plain(self._sumo, domain, "getAngle"), names))
        rows.speed_mps.extend(map(_plain(self._sumo, domain, "getSpeed"), names))

    def _on_foot(self, names: Sequence[str]) -> list[str]:
        person = self._sumo.person
        return [name for name in names if not person.getVehicle(name) and person.getStage(name).type != ACCESS_STAGE]

    def _body(self, domain: Any, name: str) -> Body:
        type_id = domain.getTypeID(name)
        if type_id not in self._sizes:
            types = self._sumo.vehicletype
            kind = kind_of_type(type_id, types.getVehicleClass(type_id))
            self._sizes[type_id] = (kind, types.getLength(type_id), types.getWidth(type_id), types.getHeight(type_id))
        return Body(name, domain is self._sumo.person, *self._sizes[type_id])


def _plain(sumo: Any, domain: Any, question: str) -> Callable[[str], Any]:
    """A domain's function without its Python wrapper, where libsumo has it; it is called millions of times."""
    own: Callable[[str], Any] = getattr(domain, question)
    return getattr(getattr(sumo, "_libsumo", None), f"{domain.__name__}_{question}", own)
