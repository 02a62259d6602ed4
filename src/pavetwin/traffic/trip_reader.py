"""Reads the trips of all vehicles from the running simulation, in the simulation's process."""

from dataclasses import dataclass
from math import inf
from typing import Any

from pavetwin.traffic.area_traffic import Trip


@dataclass
class _Driving:
    kind: str
    edges: tuple[str, ...]
    entered_s: list[float]
    """Of the edges so far."""
    seen_s: float


class TripReader:
    """Observes `sumo` (the libsumo module), to the second."""

    def __init__(self, sumo: Any) -> None:
        self._vehicle = sumo.vehicle
        self._driving: dict[str, _Driving] = {}
        self._now_s = 0.0

    def read(self) -> None:
        """Called every second."""
        vehicle, now_s = self._vehicle, self._now_s
        for name in vehicle.getIDList():
            edges = vehicle.getRouteIndex(name) + 1
            if edges < 1:
                continue  # teleported, or not on the street yet
            known = self._driving.get(name)
            if known is None:
                before = [-inf] * (edges if now_s == 0.0 else edges - 1)
                known = self._driving[name] = _Driving(vehicle.getTypeID(name), (), before, now_s)
            if edges > len(known.entered_s) or not known.edges:
                known.edges = tuple(vehicle.getRoute(name))  # a vehicle may choose another one on the way
                known.entered_s += [now_s] * (edges - len(known.entered_s))
            known.seen_s = now_s
        self._now_s += 1.0

    def take(self) -> list[Trip]:
        """The trips so far, in the order of departure."""
        return [
            Trip(it.kind, it.edges, (*it.entered_s, *[inf] * (len(it.edges) - len(it.entered_s))), it.seen_s + 1.0)
            for it in self._driving.values()
        ]
