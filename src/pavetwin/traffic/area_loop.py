"""Demand of an area: as many vehicles as its town has there, on the town's trips cut to the area.

In the first half of the warm-up vehicles start anywhere on these trips, in proportion to the time that they take on
each edge. Later they enter where trips did that came here during the observation, each as likely. Their number follows
that of the observation, second by second from a random one on, so that quiet and busy minutes come as in the town.
Behind the area they drive as fast as the town's vehicles do there, so that queues reach back into it as in the town.
Runs only in the simulation's process.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pavetwin.traffic.area_traffic import AreaTraffic, CutTrip
from pavetwin.traffic.closed_loop import FULL, JAM_LENGTH_M, Draw
from pavetwin.traffic.network import read_roads


class AreaLoop:
    """Holds the number of vehicles of an area in the running simulation `sumo` (the libsumo module)."""

    def __init__(
        self, sumo: Any, lanes_of: Mapping[str, Sequence[str]], traffic: AreaTraffic, rng: np.random.Generator
    ) -> None:
        """
        Args:
            lanes_of: as in `SimulationJob`.
        """
        self._sumo, self._present, self._rng = sumo, traffic.present, rng
        self._new = [trip for trip in traffic.trips if trip.is_new] or list(traffic.trips)
        self._places = [(trip, at) for trip in traffic.trips for at in range(len(trip.edges))]
        self._place = Draw([trip.entered_s[at + 1] - trip.entered_s[at] for trip, at in self._places])
        self._second = int(rng.integers(max(1, len(traffic.present))))
        self._count = 0
        entries = read_roads(sumo, lanes_of, {trip.edges[0] for trip in self._new})
        self._length_m = dict(zip(entries.ids, entries.length_m.tolist(), strict=True))
        for edge, speed_mps in traffic.speed_mps.items():
            sumo.edge.setMaxSpeed(edge, speed_mps)

    def fill(self, *, warming: bool) -> None:
        """Insert the missing vehicles; called every second, with `warming` before the recording begins."""
        if not self._new:
            return
        sumo = self._sumo
        wanted = self._present[self._second % len(self._present)]
        self._second += 1
        for _ in range(wanted - sumo.vehicle.getIDCount() - len(sumo.simulation.getPendingVehicles())):
            if warming:
                trip, at = self._places[self._place(self._rng)]
                self._start(trip, at, departPos="random_free", departLane="random", departSpeed="max")
                continue
            trip = self._new[int(self._rng.integers(len(self._new)))]
            if trip.departs:
                self._start(trip, 0, departPos="random_free", departLane="first", departSpeed="0")
            elif self._occupied(trip.edges[0]) < FULL:
                self._start(trip, 0, departPos="base", departLane="free", departSpeed="max")

    def _start(self, trip: CutTrip, at: int, **departure: str) -> None:
        """One vehicle, on the part of a trip from an edge on."""
        name = f"v{self._count}"
        self._count += 1
        self._sumo.route.add(name, trip.edges[at:])
        self._sumo.vehicle.add(name, name, typeID=trip.kind, **departure)

    def _occupied(self, edge: str) -> float:
        return float(self._sumo.edge.getLastStepVehicleNumber(edge) * JAM_LENGTH_M / self._length_m[edge])
