"""The simulation's own process: `python -m pavetwin.traffic.sumo_run`.

SUMO runs only here, so that a crash of SUMO ends this process and not the caller's. Standard input is one end of a
connection. The owner sends a `SimulationJob` and then, any number of times, a count of frames; the answers are shares
done and finally a `Part`. SUMO is paused between requests. After None the simulation is closed, which None answers;
then the next job may come, which is simulated as in a new process. When the other end is closed, the job's folder is
removed and the process ends.
"""

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from pavetwin.seeds import Stream, child
from pavetwin.traffic.area_loop import AreaLoop
from pavetwin.traffic.closed_loop import ClosedLoop
from pavetwin.traffic.job import OUTPUT, STEP_S, Part, SimulationJob
from pavetwin.traffic.level_control import EVERY_S, LevelControl
from pavetwin.traffic.network import close_others, islands, read_roads, read_sidewalks, signals_in
from pavetwin.traffic.readout import Readout
from pavetwin.traffic.trip_reader import TripReader

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
"""The same for every recording. Those of outputs have no effect, since positions are read from the running simulation:
they stay because recordings are found again by the hash of these."""

CLOSED_LOOP_OPTIONS: Final[tuple[str, ...]] = (
    "--no-warnings=true",
    "--max-depart-delay=1",  # where there is no room, the loop tries elsewhere a second later
    "--device.rerouting.probability=1",
    "--device.rerouting.period=60",
    "--device.rerouting.adaptation-interval=10",
)
"""With our own demand only; a user's routes are driven as they are written."""

AREA_OPTIONS: Final[tuple[str, ...]] = CLOSED_LOOP_OPTIONS[:2]
"""On an area with the vehicles of its town, which keep their routes."""

LEVEL_OPTIONS: Final[tuple[str, ...]] = ("--time-to-teleport=300",)
"""For traffic that is to flow at a level of service. In towns a vehicle may wait two minutes at a busy street without
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
    """Simulate what the owner asks for, one job after the other. Returns the exit code: 0 the owner is done or gone, 1
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
