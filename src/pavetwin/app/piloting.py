"""Flying by hand for the page, in a task process: a step of the flight each tenth of a second, as the clock has it.

What the page plays meanwhile is a mission that grows: a file with what does not change, and messages with what does.
Afterwards the flight is played as any other. It is no mission of the world: its files, and the list of what the pilot
did, are in the session's folder.
"""

import gzip
import json
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from math import isnan, nan
from pathlib import Path
from secrets import token_hex
from typing import Any, Final, Protocol

from pavetwin.app.agent_minutes import MINUTE_S, minute
from pavetwin.app.frame_source import write_frame_source
from pavetwin.app.playback import FLIGHT, AgentSizes, bodies, minute_file, still_values, write_playback
from pavetwin.app.requests import StickRequest
from pavetwin.errors import PaveTwinError
from pavetwin.mission.by_hand import PILOT, STEP_S, ByHand, Stick, sticks_as_values
from pavetwin.mission.events import BatteryRanLow, DefectsConfirmed, MissionEvent
from pavetwin.mission.inputs import MissionInputs
from pavetwin.mission.results import save_mission
from pavetwin.mission.spec import MissionSpec
from pavetwin.sensing import Sensor, load_sensor

FIRST_MINUTES: Final = 2
"""Of traffic that are there when the flight begins; the others follow while it goes on."""

PATIENCE_S: Final = 1.5
"""A stick that is held is told again and again; after this long without, it is let go."""

LATE_S: Final = 1.0
"""A flight that is this much behind the clock, while traffic was recorded, goes on from there."""

TRACK: Final = (
    *("t_s", "x_m", "y_m", "altitude_m", "speed_mps", "yaw_rad", "battery", "visibility", "mode", "segment"),
)
CAPTURES: Final = ("t_s", "x_m", "y_m", "yaw_rad")
"""Columns of a mission that grow; see `pavetwin.app.playback.mission_values`."""

STICKS: Final = "by-hand.json"


class PilotReport(Protocol):
    """Who is told how the flight goes, and tells what the pilot does."""

    def __call__(self, share: float, what: str, /) -> None: ...

    def ready(self, values: Mapping[str, Any], /) -> None: ...

    def live(self, values: Mapping[str, Any], /) -> None: ...

    def said(self) -> list[Mapping[str, Any]]:
        """What was said since."""


def fly_by_hand(spec: MissionSpec, inputs: MissionInputs, session: Path, tell: PilotReport) -> dict[str, Any]:
    """Fly until the pilot has landed, and write what plays the flight.

    Args:
        spec: whose environment, traffic, sensor and settings are flown with.
        session: the folder of the session.

    Raises:
        PaveTwinError: the sensor does not answer in flight, or the flight cannot go on.
    """
    sensor = load_sensor(spec.settings.sensing, spec.seed)
    if sensor.after_landing:
        raise PaveTwinError(
            f"`sensor`: '{sensor.name}' looks at images after landing; by hand choose one that answers at once, as "
            "calibrated does."
        )
    flight = ByHand(
        inputs.environment,
        inputs.traffic,
        spec.settings,
        [],
        policy=PILOT,
        sensor=sensor.name,
        other_classes=sensor.other_classes,
        every_capture=sensor.every_capture,
        sees_confirmed=sensor.sees_confirmed,
    )
    inputs.on_extend(lambda share: tell(share, "Recording more traffic"))
    with _live_folder(session) as folder:
        _Live(flight, inputs, folder, tell).fly(sensor)
        tell(1.0, "Preparing to play")
        return _written(flight, spec, inputs, session)


@contextmanager
def _live_folder(session: Path) -> Iterator[Path]:
    folder = session / f"live{token_hex(8)}"
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Live:
    """The flight as the page sees it while it goes on."""

    def __init__(self, flight: ByHand, inputs: MissionInputs, folder: Path, tell: PilotReport) -> None:
        self._flight, self._inputs, self._folder, self._tell = flight, inputs, folder, tell
        self._captures = self._minutes = 0
        self._sizes: AgentSizes = {}
        self._agents: dict[str, Any] = {}
        self._stick, self._said_s = Stick(), time.monotonic()

    def fly(self, sensor: Sensor) -> None:
        self._write_minutes(FIRST_MINUTES)
        self._begin()
        begun_s, step = time.monotonic(), 0
        while not self._flight.is_over:
            events = self._flight.step(self._read_stick(), sensor)
            known, state = self._minutes, self._state(events)
            self._write_minutes(int(self._flight.duration_s / MINUTE_S) + FIRST_MINUTES)
            more = {} if known == self._minutes else {"minutes": self._minutes, "agents": self._agents}
            self._tell.live(state | more)
            step += 1
            behind_s = time.monotonic() - begun_s - step * STEP_S
            if behind_s > LATE_S:
                begun_s += behind_s
            elif behind_s < 0:
                time.sleep(-behind_s)

    def _read_stick(self) -> Stick:
        now_s = time.monotonic()
        for values in self._tell.said():
            self._stick, self._said_s = Stick(**StickRequest.of(values).model_dump()), now_s
        if now_s - self._said_s > PATIENCE_S:
            self._stick = Stick(lands=self._stick.lands)
        return self._stick

    def _begin(self) -> None:
        known = {
            "step_s": self._inputs.replay.recording.step_s,
            "minutes": self._minutes,
            "agents": self._agents,
            "missions": [
                {
                    **still_values(self._flight.environment, self._flight.settings, PILOT, self._flight.sensor),
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
        text = json.dumps(known, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        (self._folder / FLIGHT).write_bytes(gzip.compress(text.encode(), 1, mtime=0))
        self._tell.ready(
            {"key": self._folder.name, "results": str(self._folder), "names": [], "captures": [0], "policies": [PILOT]}
        )

    def _write_minutes(self, count: int) -> None:
        """The traffic of the first minutes; what was not recorded yet is recorded now."""
        step_s = self._inputs.replay.recording.step_s
        for number in range(self._minutes, count):
            from_s, until_s = number * MINUTE_S, (number + 1) * MINUTE_S
            trace = self._flight.traffic.extend(until_s)
            content = minute(trace, step_s, number)
            (self._folder / minute_file(number)).write_bytes(gzip.compress(content, 1, mtime=0))
            self._agents = bodies(trace, step_s, until_s, from_s=from_s, known=self._sizes)
            self._minutes = number + 1

    def _state(self, events: Sequence[MissionEvent]) -> dict[str, Any]:
        flight, uav = self._flight.flight, self._flight.state()
        captures = flight.captures()
        new = slice(self._captures, None)
        self._captures = len(captures["t_s"])
        looks = flight.track()["visibility"]
        visibility = float(looks[-1]) if len(looks) else nan
        found = [number for event in events if isinstance(event, DefectsConfirmed) for number in event.defects]
        return {
            "t_s": round(flight.time_s, 3),
            "place_m": [round(each, 3) for each in uav.position],
            "altitude_m": round(uav.altitude_m, 3),
            "yaw_rad": round(uav.yaw_rad, 4),
            "speed_mps": round(uav.speed_mps, 3),
            "battery": round(uav.battery, 5),
            "mode": flight.mode,
            "visibility": None if isnan(visibility) else round(visibility, 4),
            "segment": self._flight.looked_at,
            "coverage": {name: round(share, 4) for name, share in self._flight.coverage().items()},
            "captures": {name: captures[name][new].round(4).tolist() for name in CAPTURES},
            "found": [self._defect(number) for number in found],
            "is_low": any(isinstance(event, BatteryRanLow) for event in events),
        }

    def _defect(self, number: int) -> dict[str, Any]:
        defect = self._flight.environment.defects[number]
        return {
            "id": number,
            "segment": defect.segment,
            "class": defect.kind,
            "severity": defect.severity.value,
            "area_m2": round(defect.area_m2, 4),
            "place_m": [round(defect.centre.x, 3), round(defect.centre.y, 3)],
            "outcome": "found",
            "found_s": round(self._flight.flight.time_s, 3),
        }


def _written(flight: ByHand, spec: MissionSpec, inputs: MissionInputs, session: Path) -> dict[str, Any]:
    """The flight as the page plays it, its files, and the list of what the pilot did."""
    result = flight.result(spec.seed)
    sticks = {"step_s": STEP_S, "sticks": sticks_as_values(flight.changes)}
    known = json.dumps([spec.as_values(), sticks], sort_keys=True)
    key = sha256(known.encode()).hexdigest()[:20]
    target, made = session / key, session / f"{key}.part"
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir()
    write_playback([result], made, step_s=inputs.replay.recording.step_s)
    write_frame_source([result], made)
    save_mission(result, made / "results")
    (made / "results" / STICKS).write_text(json.dumps(sticks, indent=1), encoding="utf-8")
    shutil.rmtree(target, ignore_errors=True)
    made.replace(target)
    results = target / "results"
    names = sorted(path.name for path in results.iterdir() if path.is_file())
    known_as = {"key": key, "captures": [len(result.captures["t_s"])], "policies": [PILOT]}
    return {**known_as, "results": str(results), "names": names}
