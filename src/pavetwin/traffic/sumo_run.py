"""The simulation's own process: `python -m pavetwin.traffic.sumo_run JOB.json`.

SUMO runs here and nowhere else, so that a crash of SUMO ends this process and not the caller's. The job names the
inputs; this process leaves `vehicles.parquet` and `persons.parquet` (written by SUMO itself) and `run.json` in the
job's folder, and reports on its standard output one line `@SHARE` now and then. When nobody reads these lines any more,
the caller was killed: then the job's folder is removed and the process ends.
"""

import json
import shutil
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from pavetwin.seeds import Stream, child
from pavetwin.traffic.closed_loop import ClosedLoop
from pavetwin.traffic.kinds import kind_of_type
from pavetwin.traffic.network import read_roads, read_sidewalks

STEP_S: Final = 0.5
"""SUMO's step and the recording's."""

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
"""The same for every recording."""

CLOSED_LOOP_OPTIONS: Final[tuple[str, ...]] = (
    "--no-warnings=true",
    "--max-depart-delay=1",  # where there is no room, the loop tries elsewhere a second later
    "--device.rerouting.probability=1",
    "--device.rerouting.period=60",
    "--device.rerouting.adaptation-interval=10",
)
"""With our own demand only; a user's routes are driven as they are written."""


@dataclass(frozen=True)
class Job:
    """What one run needs. Paths are absolute."""

    folder: str
    network: str
    additional: str
    routes: list[str]
    """A user's own demand; empty for the closed loop."""
    seed: int
    sumo_seed: int
    frames: int
    """How many steps to record, the first at the end of the warm-up."""
    warm_up_s: tuple[float, float]
    """The shortest and the longest warm-up."""
    begin_s: float = 0.0
    """SUMO's clock at its first step."""
    vehicles: int = 0
    pedestrians: int = 0


@dataclass
class Outcome:
    """What SUMO's own output does not hold."""

    start_s: float = 0.0
    """Simulated time of the recording's first step."""
    vehicles: dict[str, tuple[str, float, float, float]] = field(default_factory=dict)
    """By SUMO's id: kind, length, width, height in metres."""
    persons: dict[str, tuple[str, float, float, float]] = field(default_factory=dict)
    """The same; a user's person may have a vehicle's id."""
    removals: list[tuple[int, int]] = field(default_factory=list)
    """(step, number of vehicles that SUMO took out of gridlock) from the recording's start on."""
    signals: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    """Per traffic light, (step, state of its links) at step 0 and at each change."""
    sumo_version: str = ""


def run(sumo: Any, job: Job) -> Outcome:
    """Run SUMO to the end of the job."""
    folder = Path(job.folder)
    options = [
        "sumo",
        f"--net-file={job.network}",
        f"--additional-files={job.additional}",
        f"--step-length={STEP_S}",
        f"--seed={job.sumo_seed}",
        f"--fcd-output={folder / 'vehicles.parquet'}",
        f"--person-fcd-output={folder / 'persons.parquet'}",
        f"--begin={job.begin_s}",
        f"--device.fcd.begin={job.begin_s + job.warm_up_s[0]}",
        *OPTIONS,
        *([f"--route-files={','.join(job.routes)}"] if job.routes else CLOSED_LOOP_OPTIONS),
    ]
    sumo.start(options)
    try:
        return _Run(sumo, job).to_the_end()
    finally:
        sumo.close()


class _Run:
    def __init__(self, sumo: Any, job: Job) -> None:
        self._sumo, self._job = sumo, job
        self._outcome = Outcome(sumo_version=sumo.getVersion()[1])
        self._bodies: dict[str, tuple[str, float, float, float]] = {}
        self._removed = 0
        self._loop: ClosedLoop | None = None
        if not job.routes:
            rng = child(job.seed, Stream.DEMAND)
            self._loop = ClosedLoop(
                sumo, read_roads(sumo), read_sidewalks(sumo), job.vehicles, job.pedestrians, rng
            )  # fmt: skip

    def to_the_end(self) -> Outcome:
        warm_up = self._warm_up()
        self._outcome.start_s = self._job.begin_s + warm_up * STEP_S
        states = dict.fromkeys(self._sumo.trafficlight.getIDList(), "")
        signals: dict[str, list[tuple[int, str]]] = {name: [] for name in states}
        for step in range(self._job.frames):
            self._step(step, warming=False)
            for name, before in states.items():
                state = self._sumo.trafficlight.getRedYellowGreenState(name)
                if state != before:
                    states[name] = state
                    signals[name].append((step, state))
            if step % 50 == 0:
                _report((warm_up + step + 1) / (warm_up + self._job.frames))
        self._outcome.signals = signals
        self._outcome.removals = [(step, count) for step, count in self._outcome.removals if step >= 0]
        return self._outcome

    def _warm_up(self) -> int:
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
                _report(steps / (longest + self._job.frames))
            if (
                steps >= shortest
                and abs(sum(counts[-window:]) / window - self._job.vehicles) <= 0.05 * self._job.vehicles
            ):
                break
        return steps

    def _step(self, step: int, *, warming: bool) -> None:
        sumo = self._sumo
        if self._loop is not None and step % 2 == 0:
            self._loop.fill(warming=warming)
        sumo.simulationStep()
        for name in sumo.simulation.getDepartedIDList():
            self._outcome.vehicles[name] = self._body(sumo.vehicle.getTypeID(name))
        for name in sumo.simulation.getDepartedPersonIDList():
            self._outcome.persons[name] = self._body(sumo.person.getTypeID(name))
        removed = int(sumo.simulation.getParameter("", "stats.teleports.total")) - self._removed
        if removed:
            self._removed += removed
            self._outcome.removals.append((step, removed))

    def _body(self, type_id: str) -> tuple[str, float, float, float]:
        if type_id not in self._bodies:
            types = self._sumo.vehicletype
            kind = kind_of_type(type_id, types.getVehicleClass(type_id))
            size = (types.getLength(type_id), types.getWidth(type_id), types.getHeight(type_id))
            self._bodies[type_id] = (kind, *size)
        return self._bodies[type_id]


def _report(share: float) -> None:
    print(f"@{share:.4f}", flush=True)


def main(path: str) -> int:
    """Run the job in the file `path`. Returns the exit code: 0 done, 1 SUMO refused, 3 the caller is gone."""
    import libsumo

    job = Job(**json.loads(Path(path).read_text()))
    try:
        outcome = run(libsumo, job)
        text = json.dumps(asdict(outcome))
        (Path(job.folder) / "run.json").write_text(text)
        _report(1.0)
    except BrokenPipeError:
        shutil.rmtree(job.folder, ignore_errors=True)
        return 3
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        print("Error:", " ".join(str(error).split()), file=sys.stderr)
        return 1
    except OSError as error:
        print(f"Error: cannot write in '{job.folder}': {error.strerror}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
