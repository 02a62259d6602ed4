"""The simulation's own process: `python -m pavetwin.traffic.sumo_run`.

SUMO runs only here, so that a crash of SUMO ends this process and not the caller's. Standard input is one end of a
connection. The owner sends a `SimulationJob` and then, any number of times, a count of frames; the answers are shares
done and finally a `Part`. SUMO is paused between requests. None closes the simulation and is answered by None; the next
job may follow, and runs as in a new process. When the other end is closed, the job's folder is removed and the process
ends.

`AreaLoop` holds the demand of an area: as many vehicles as its town has there, on the town's trips cut to the area. In
the first half of the warm-up vehicles start anywhere on these trips, in proportion to the time that they take on each
edge. Later they enter where trips entered during the observation, each with equal probability. Their number follows
that of the observation, second by second from a random one on, so that quiet and busy minutes come as in the town.
Behind the area they drive as fast as the town's vehicles do there, so that queues reach back into it as in the town.

`LevelControl` holds a level of service: one density gives a speed ratio only on average over days, since near capacity
a queue that happens to spill back changes it by a tenth or more. So the number of vehicles follows a
proportional-integral law on the relative error of the speed ratio, from the density of `demand_search` on.
"""

import os
import shutil
import sys
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from itertools import chain
from math import exp, inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from pavetwin.seeds import Stream, child
from pavetwin.traffic.closed_loop import (
    FULL,
    JAM_LENGTH_M,
    ClosedLoop,
    Draw,
    close_others,
    islands,
    read_roads,
    read_sidewalks,
    signals_in,
)
from pavetwin.traffic.job import (
    OUTPUT,
    STEP_S,
    AreaTraffic,
    Body,
    CutTrip,
    Part,
    SimulationJob,
    SpeedLimits,
    Trip,
    yaw_of_heading,
)
from pavetwin.traffic.kinds import kind_of_type


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
        """Insert a vehicle on the part of a trip from an edge on."""
        name = f"v{self._count}"
        self._count += 1
        self._sumo.route.add(name, trip.edges[at:])
        self._sumo.vehicle.add(name, name, typeID=trip.kind, **departure)

    def _occupied(self, edge: str) -> float:
        return float(self._sumo.edge.getLastStepVehicleNumber(edge) * JAM_LENGTH_M / self._length_m[edge])


EVERY_S: Final = 10
"""The speed ratio is measured so often."""

AVERAGED: Final = 12
"""The proportional part sees the mean of so many measurements: two signal cycles."""

PROPORTIONAL: Final = 0.5
INTEGRAL_PER_S: Final = 1 / 600
"""Relative change of the number of vehicles by a relative error of 1, at once and in each second."""

LARGEST: Final = 0.5
"""The logarithm of the number of vehicles changes by no more than this."""


class LevelControl:
    """Corrects the number of vehicles in the running simulation `sumo` (the libsumo module)."""

    def __init__(self, sumo: Any, limits: SpeedLimits, target: float, vehicles: int) -> None:
        self._sumo = sumo
        self._limits = limits
        self._target = target
        self._found = vehicles
        self._errors: deque[float] = deque(maxlen=AVERAGED)
        self._sum = 0.0

    def vehicles(self) -> int:
        """Target number from now on; called every `EVERY_S` seconds."""
        ratio = self._ratio()
        if ratio is not None:
            error = ratio / self._target - 1
            self._errors.append(error)
            most = LARGEST / INTEGRAL_PER_S
            self._sum = min(most, max(-most, self._sum + error * EVERY_S))
        change = PROPORTIONAL * float(np.mean(self._errors or [0.0])) + INTEGRAL_PER_S * self._sum
        return max(1, round(self._found * exp(min(LARGEST, max(-LARGEST, change)))))

    def _ratio(self) -> float | None:
        vehicle = self._sumo.vehicle
        names = vehicle.getIDList()
        if not names:
            return None
        xy = np.array([vehicle.getPosition(name) for name in names])
        yaw = yaw_of_heading([vehicle.getAngle(name) for name in names])
        speed = np.array([vehicle.getSpeed(name) for name in names])
        return float((speed / self._limits.at(xy[:, 0], xy[:, 1], yaw)).mean())


ACCESS_STAGE: Final = 4
"""SUMO's number for a stage between a street and a platform, on neither of which the person is."""


@dataclass
class Rows:
    """The frames since the last part, in the order of reading."""

    frame: "array[int]" = field(default_factory=lambda: array("I"))
    """Number of rows of each frame."""
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


@dataclass
class _Driving:
    kind: str
    edges: tuple[str, ...]
    entered_s: list[float]
    """Entry times of the edges so far."""
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


SETTLING_S: Final = 20.0
"""The numbers of agents are judged over this long."""

OPTIONS: Final[tuple[str, ...]] = (
    "--no-step-log=true",
    "--duration-log.disable=true",
    "--xml-validation=never",
    "--precision=3",
    "--fcd-output.attributes=x,y,angle,speed",
    "--fcd-output.skip-empty=true",
    "--pedestrian.model=striping",
    "--collision.action=none",  # bodies may graze on a crowded junction; removing one would be seen
    "--time-to-teleport=120",
    "--time-to-teleport.remove=true",  # a vehicle in gridlock is replaced elsewhere instead of jumping ahead
    "--ignore-junction-blocker=15",
    "--time-to-impatience=60",
    "--random-depart-offset=0",
)
"""Options of every recording. Those of outputs have no effect, since positions are read from the running simulation:
they stay because recordings are found again by the hash of these."""

CLOSED_LOOP_OPTIONS: Final[tuple[str, ...]] = (
    "--no-warnings=true",
    "--max-depart-delay=1",  # where there is no room, the loop tries elsewhere a second later
    "--device.rerouting.probability=1",
    "--device.rerouting.period=60",
    "--device.rerouting.adaptation-interval=10",
)
"""Options for generated demand; a user's routes are driven as they are written."""

AREA_OPTIONS: Final[tuple[str, ...]] = CLOSED_LOOP_OPTIONS[:2]
"""Options for an area with the vehicles of its town, which keep their routes."""

LEVEL_OPTIONS: Final[tuple[str, ...]] = ("--time-to-teleport=300",)
"""Options for traffic at a level of service. In towns a vehicle may wait two minutes at a busy street without
being in gridlock; after five minutes it is."""


class Simulation:
    """SUMO at work on a job, in this process."""

    def __init__(self, sumo: Any, job: SimulationJob, report: Callable[[float], None]) -> None:
        self._sumo, self._job, self._report = sumo, job, report
        replaced = {option.partition("=")[0] for option in job.options}
        loop_options = CLOSED_LOOP_OPTIONS if job.area_traffic is None else AREA_OPTIONS
        sumo.start(
            [
                "sumo",
                f"--net-file={job.network}",
                f"--additional-files={job.additional}",
                f"--step-length={STEP_S}",
                f"--seed={job.sumo_seed}",
                f"--begin={job.begin_s}",
                *(option for option in OPTIONS if option.partition("=")[0] not in replaced),
                *job.options,
                *([f"--route-files={','.join(job.routes)}"] if job.routes else loop_options),
            ]
        )
        self._readout = Readout(sumo, riders=bool(job.routes), pedestrians=job.reads_pedestrians)
        self._warm_up: int | None = None
        self._frames = 0
        self._removed = 0
        self._removals: list[tuple[int, int]] = []
        signals = sumo.trafficlight.getIDList() if job.area is None else signals_in(sumo, job.lanes_of, job.area)
        self._states = dict.fromkeys(signals, "")
        self._trips = TripReader(sumo) if job.reads_trips else None
        self._loops: list[ClosedLoop | AreaLoop] = [] if job.routes else [*_loops(sumo, job)]
        self._control: LevelControl | None = None
        if job.speed_ratio is not None and job.speed_limits is not None:
            self._control = LevelControl(sumo, job.speed_limits, job.speed_ratio, job.vehicles)

    def record(self, frames: int) -> Part:
        """The next `frames` frames; the first time the warm-up comes before them."""
        before = 0
        if self._warm_up is None:
            before = self._warm_up = self._warm(frames)
        self._removals = []
        signals: dict[str, list[tuple[int, str]]] = {name: [] for name in self._states}
        for done in range(1, frames + 1):
            self._step(self._frames, warming=False)
            if self._trips is None:
                self._readout.read()
            elif self._frames % 2 == 0:
                self._trips.read()
            for name, last in self._states.items():
                state = self._sumo.trafficlight.getRedYellowGreenState(name)
                if state != last:
                    self._states[name] = state
                    signals[name].append((self._frames, state))
            self._frames += 1
            if done % 50 == 0 or done == frames:
                self._report((before + done) / (before + frames))
        return Part(
            start_s=self._job.begin_s + self._warm_up * STEP_S,
            sumo_version=self._sumo.getVersion()[1],
            removals=self._removals,
            signals=signals,
            trips=[] if self._trips is None else self._trips.take(),
            **self._readout.take().columns(),
        )

    def _warm(self, frames: int) -> int:
        """Run until the numbers are held or the longest warm-up is over; returns its steps."""
        shortest, longest = (round(seconds / STEP_S) for seconds in self._job.warm_up_s)
        window = round(SETTLING_S / STEP_S)
        counts: list[int] = []
        steps = 0
        while steps < longest:
            self._step(steps - longest, warming=steps < shortest / 2)
            steps += 1
            counts.append(self._sumo.vehicle.getIDCount())
            if steps % 50 == 0:
                self._report(steps / (longest + frames))
            missed = abs(sum(counts[-window:]) / window - self._job.vehicles)
            if steps >= shortest and (self._job.area_traffic is not None or missed <= 0.05 * self._job.vehicles):
                break
        return steps

    def _step(self, step: int, *, warming: bool) -> None:
        if self._control is not None and step >= 0 and step % round(EVERY_S / STEP_S) == 0:
            vehicles = self._control.vehicles()
            for loop in self._loops:
                if isinstance(loop, ClosedLoop):
                    loop.hold(vehicles)
        if step % 2 == 0:
            for loop in self._loops:
                loop.fill(warming=warming)
        self._sumo.simulationStep()
        removed = int(self._sumo.simulation.getParameter("", "stats.teleports.total")) - self._removed
        if removed:
            self._removed += removed
            self._removals.append((step, removed))


def _loops(sumo: Any, job: SimulationJob) -> Iterator[ClosedLoop | AreaLoop]:
    """The demand: one loop, or one for each island of an area, whose agents are in proportion to its streets."""
    if job.area is None:
        ways = read_roads(sumo, job.lanes_of), read_sidewalks(sumo, job.lanes_of)
        rng = child(job.seed, Stream.DEMAND)
        yield ClosedLoop(
            sumo, *ways, job.vehicles, job.pedestrians, rng, job.vehicle_types, fastest_goals=job.fastest_goals
        )
        return
    parts = islands(sumo, job.area)
    roads = [read_roads(sumo, job.lanes_of, part) for part in parts]
    sidewalks = [read_sidewalks(sumo, job.lanes_of, part) for part in parts]
    if job.area_traffic is None:
        close_others(sumo, job.lanes_of, job.area)
    else:
        yield AreaLoop(sumo, job.lanes_of, job.area_traffic, child(job.seed, Stream.DEMAND, len(parts)))
    vehicles = shares(job.vehicles if job.area_traffic is None else 0, [each.length_m.sum() for each in roads])
    pedestrians = shares(job.pedestrians, [each.length_m.sum() for each in sidewalks])
    for number, (road, sidewalk, cars, walkers) in enumerate(zip(roads, sidewalks, vehicles, pedestrians, strict=True)):
        rng = child(job.seed, Stream.DEMAND, number)
        name = f"{number}-" if len(parts) > 1 else ""
        goals = job.fastest_goals
        yield ClosedLoop(sumo, road, sidewalk, cars, walkers, rng, job.vehicle_types, fastest_goals=goals, prefix=name)


def shares(count: int, weights: Sequence[float]) -> list[int]:
    """A number divided in proportion to weights, so that the parts sum up to it."""
    ends = np.round(count * np.cumsum([0.0, *weights]) / max(sum(weights), 1e-9))
    return [int(part) for part in np.diff(ends)]


def serve(owner: Connection) -> int:
    """Run the owner's jobs, one after the other. Returns the exit code: 0 the owner is done or gone, 1
    SUMO refused."""
    sys.modules.setdefault("pyproj", None)  # type: ignore[arg-type] # libsumo's tools would load it, and need it not
    with redirect_stdout(None):  # what the module prints when it is imported is not SUMO's
        import libsumo
    while True:
        try:
            job: SimulationJob = owner.recv()
        except (EOFError, ConnectionError):
            return 0
        try:
            with Path(job.folder, OUTPUT).open("wb") as sink:
                os.dup2(sink.fileno(), sys.stdout.fileno())
                os.dup2(sink.fileno(), sys.stderr.fileno())
            simulation = Simulation(libsumo, job, owner.send)
            while (frames := owner.recv()) is not None:
                owner.send(simulation.record(frames))
            libsumo.close()
            owner.send(None)
        except (EOFError, ConnectionError):
            shutil.rmtree(job.folder, ignore_errors=True)
            return 0
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            print("Error:", " ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
            return 1


if __name__ == "__main__":
    sys.exit(serve(Connection(sys.stdin.fileno())))
