"""What is steered by hand for the page, in a task process: a step each tenth of a second, as the clock has it.

What the page plays meanwhile is a mission that grows: a file with what does not change, and messages with what does.
"""

import gzip
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from typing import Any, Final, Protocol

from pavetwin.app.agent_minutes import MINUTE_S, minute
from pavetwin.app.playback import AgentSizes, bodies, minute_file, write_flight
from pavetwin.app.requests import StickRequest
from pavetwin.mission.by_hand import STEP_S
from pavetwin.mission.inputs import MissionInputs
from pavetwin.mission.mission import Traffic

FIRST_MINUTES: Final = 2
"""Of traffic that are there at the beginning; the others follow while it goes on."""

PATIENCE_S: Final = 1.5
"""A stick that is held is told again and again; after this long without, it is let go."""

LATE_S: Final = 1.0
"""What is this much behind the clock, while traffic was recorded, goes on from there."""

TRACK: Final = (
    *("t_s", "x_m", "y_m", "altitude_m", "speed_mps", "yaw_rad", "battery", "visibility", "mode", "segment"),
)
CAPTURES: Final = ("t_s", "x_m", "y_m", "yaw_rad")
"""Columns of a mission that grow; see `pavetwin.app.playback.mission_values`."""


class PilotReport(Protocol):
    """Who is told how it goes, and tells what the pilot does."""

    def __call__(self, share: float, what: str, /) -> None: ...

    def ready(self, values: Mapping[str, Any], /) -> None: ...

    def live(self, values: Mapping[str, Any], /) -> None: ...

    def said(self) -> list[Mapping[str, Any]]:
        """What was said since."""


class LiveVehicle(Protocol):
    """What is steered."""

    policy: str
    """Stands where the name of a policy does."""

    @property
    def is_over(self) -> bool: ...

    @property
    def time_s(self) -> float: ...

    @property
    def traffic(self) -> Traffic: ...

    def step(self, stick: StickRequest) -> None:
        """Go on for `STEP_S`."""

    def still(self) -> Mapping[str, Any]:
        """What of the mission does not change."""

    def state(self) -> Mapping[str, Any]:
        """What has changed with the last step, and is now."""


def steer_live(vehicle: LiveVehicle, inputs: MissionInputs, session: Path, tell: PilotReport) -> None:
    """Go on until it is over, with a folder of the session that is gone afterwards.

    Raises:
        PaveTwinError: it cannot go on.
    """
    inputs.on_extend(lambda share: tell(share, "Recording more traffic"))
    with _live_folder(session) as folder:
        _Live(vehicle, inputs, folder, tell).run()
        tell(1.0, "Preparing to play")


@contextmanager
def _live_folder(session: Path) -> Iterator[Path]:
    folder = session / f"live{token_hex(8)}"
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Live:
    """A vehicle as the page sees it while it goes on."""

    def __init__(self, vehicle: LiveVehicle, inputs: MissionInputs, folder: Path, tell: PilotReport) -> None:
        self._vehicle, self._inputs, self._folder, self._tell = vehicle, inputs, folder, tell
        self._minutes = 0
        self._sizes: AgentSizes = {}
        self._agents: dict[str, Any] = {}
        self._stick, self._said_s = StickRequest(), time.monotonic()

    def run(self) -> None:
        self._write_minutes(FIRST_MINUTES)
        self._begin()
        begun_s, step = time.monotonic(), 0
        while not self._vehicle.is_over:
            self._vehicle.step(self._read_stick())
            known, state = self._minutes, self._vehicle.state()
            self._write_minutes(int(self._vehicle.time_s / MINUTE_S) + FIRST_MINUTES)
            more = {} if known == self._minutes else {"minutes": self._minutes, "agents": self._agents}
            self._tell.live({**state, **more})
            step += 1
            behind_s = time.monotonic() - begun_s - step * STEP_S
            if behind_s > LATE_S:
                begun_s += behind_s
            elif behind_s < 0:
                time.sleep(-behind_s)

    def _read_stick(self) -> StickRequest:
        now_s = time.monotonic()
        for values in self._tell.said():
            self._stick, self._said_s = StickRequest.of(values), now_s
        if now_s - self._said_s > PATIENCE_S:
            self._stick = StickRequest(lands=self._stick.lands)
        return self._stick

    def _begin(self) -> None:
        known = {
            "step_s": self._inputs.replay.recording.step_s,
            "minutes": self._minutes,
            "agents": self._agents,
            "missions": [
                {
                    **self._vehicle.still(),
                    "duration_s": 0.0,
                    "targets": [],
                    "events": [],
                    "defects": [],
                    "track": {name: [] for name in TRACK},
                    "captures": {name: [] for name in CAPTURES},
                }
            ],
            "tables": [],
            "sentence": "",
            "remarks": [],
        }
        write_flight(known, self._folder, level=1)
        played = {"key": self._folder.name, "results": str(self._folder), "names": []}
        self._tell.ready({**played, "captures": [0], "policies": [self._vehicle.policy]})

    def _write_minutes(self, count: int) -> None:
        """The traffic of the first minutes; what was not recorded yet is recorded now."""
        step_s = self._inputs.replay.recording.step_s
        for number in range(self._minutes, count):
            from_s, until_s = number * MINUTE_S, (number + 1) * MINUTE_S
            trace = self._vehicle.traffic.extend(until_s)
            content = minute(trace, step_s, number)
            (self._folder / minute_file(number)).write_bytes(gzip.compress(content, 1, mtime=0))
            self._agents = bodies(trace, step_s, until_s, from_s=from_s, known=self._sizes)
            self._minutes = number + 1
