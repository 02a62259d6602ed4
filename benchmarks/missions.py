"""Whole missions without rendering, flown as `pavetwin fly` does, on one core."""

import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import pavetwin.mission.mission as loop
from benchmarks.measure import Kind, Line
from benchmarks.process import peak_mib
from pavetwin._core import Flight, Trace
from pavetwin.config import MissionSettings, load_settings
from pavetwin.mission.environment import MissionEnvironment, new_flight, prepare
from pavetwin.mission.fly import fly_over
from pavetwin.mission.planning import choose_targets
from pavetwin.mission.replay import Replay
from pavetwin.mission.result import MissionResult
from pavetwin.policies import policy_names
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.cache import cached
from pavetwin.world.model import World
from pavetwin.world.store import load_world

ALTITUDE_M, SEED = 10.0, 1
REAL_TIME_TARGET = 3000.0
SENSOR_TARGET = 1.25
FITTED = Path(__file__).parents[1] / "tests" / "sensing" / "fitted.json"
"""A sensor with stated parameters: one false alarm for each 100 m² of an image."""


@dataclass
class Course:
    """A world, its traffic, and the segments to fly over."""

    environment: MissionEnvironment
    replay: Replay
    targets: list[int]
    settings: MissionSettings = field(default_factory=lambda: load_settings(altitude_m=ALTITUDE_M))

    @classmethod
    def over(cls, world: World, replay: Replay, segments: int) -> "Course":
        settings = load_settings(altitude_m=ALTITUDE_M)
        environment = prepare(world, settings)
        return cls(environment, replay, choose_targets(environment, count=segments, seed=SEED), settings)

    def fly(self, policy: str, settings: MissionSettings | None = None) -> MissionResult:
        return fly_over(self.environment, self.replay, settings or self.settings, self.targets, policy, seed=SEED)


class _Clocked:
    """A flight that notes how long the kernel runs; everything else it passes on."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self.spent_s = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._flight, name)

    def advance(self, until_s: float | None = None) -> object:
        begun = time.perf_counter()
        event = self._flight.advance(until_s)
        self.spent_s += time.perf_counter() - begun
        return event


def lines(course: Course, runs: int) -> Iterator[Line]:
    """Each policy."""
    for policy in policy_names():
        result = course.fly(policy)  # warm-up; it extends the recording if needed
        times = []
        for _ in range(runs):
            begun = time.perf_counter()
            course.fly(policy)
            times.append(time.perf_counter() - begun)
        took_s = statistics.median(times)
        yield Line(
            f"mission, {policy}, high traffic",
            result.duration_s / took_s,
            Kind.REAL_TIME,
            REAL_TIME_TARGET,
            took_s=took_s,
            note=f"{result.duration_s:.0f} s flown; {_kernel_share(course, policy):.0%} of the time in the kernel",
        )


def _kernel_share(course: Course, policy: str) -> float:
    """Of one mission's time, what passes between asking the kernel for the next event and getting it."""
    clocked: list[_Clocked] = []

    def made(
        environment: MissionEnvironment, trace: Trace, settings: MissionSettings, *, every_capture: bool
    ) -> _Clocked:
        clocked.append(_Clocked(new_flight(environment, trace, settings, every_capture=every_capture)))
        return clocked[-1]

    with patch.object(loop, "new_flight", made):
        begun = time.perf_counter()
        course.fly(policy)
        took_s = time.perf_counter() - begun
    return clocked[0].spent_s / took_s


def look_line(course: Course, runs: int) -> Line:
    """One visibility evaluation at 15 m: what looking at every time step adds to a mission that looks at every sixth.

    It is a difference of two missions and so the mean over many places; the median of one place's is Criterion's.
    """
    unanswered = "visibility.threshold=0"  # no look falls below it, so that none becomes an event
    usual = load_settings(altitude_m=15.0, overrides=[unanswered])
    often = load_settings(altitude_m=15.0, overrides=[unanswered, f"visibility.interval_s={usual.time_step_s}"])
    high = Course(prepare(course.environment.world, usual), course.replay, course.targets, usual)
    extra = _looks(high.fly("baseline", often)) - _looks(high.fly("baseline"))
    differences = []
    for _ in range(runs):
        times = []
        for chosen in (usual, often):
            begun = time.perf_counter()
            high.fly("baseline", chosen)
            times.append(time.perf_counter() - begun)
        differences.append((times[1] - times[0]) / extra)
    return Line(
        "one visibility evaluation, high traffic, 15 m",
        statistics.median(differences),
        Kind.SECONDS,
        10e-6,
        note=f"mean of {extra:,.0f} looks of a flight; the median of one: Criterion, below",
    )


def sensor_line(course: Course, runs: int) -> Line:
    """Missions with a fitted sensor against the same with `recall`, in pairs, by processor time."""
    recall = course.settings
    sensing = {"sensor": "calibrated", "options": {"fitted": str(FITTED)}}
    fitted = load_settings(altitude_m=ALTITUDE_M, sensing=sensing)
    ratios = []
    for run in range(runs + 1):
        spent = []
        for settings in (recall, fitted):
            begun = time.process_time()
            course.fly("hover", settings)
            spent.append(time.process_time() - begun)
        if run:  # the first is a warm-up
            ratios.append(spent[1] / spent[0])
    return Line("mission, hover, calibrated against recall", statistics.median(ratios), Kind.RATIO, SENSOR_TARGET)


def _looks(result: MissionResult) -> int:
    return int(np.isfinite(result.track["visibility"]).sum())


def memory_line(folder: Path, segments: int) -> Line:
    """The most memory that a process holds which loads a world and its traffic and flies one mission."""
    command = [sys.executable, "-m", "benchmarks.missions", str(folder), str(segments)]
    root = Path(__file__).resolve().parent.parent
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=root)
    libraries, whole = map(float, done.stdout.split())
    note = f"world and traffic loaded, hover flown; Python and its libraries alone: {libraries:.0f} MiB"
    return Line("memory of a mission, at most", whole, Kind.MEBIBYTES, note=note)


def main(folder: Path, segments: int) -> None:
    """Fly once over what was recorded; print the peak resident memory before and after, in MiB."""
    libraries = peak_mib()
    world = load_world(folder)
    recording = load_recording(cached(world, f"traffic/high-{SEED}.parquet"))
    Course.over(world, Replay(world, recording), segments).fly("hover")
    print(libraries, peak_mib())


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
