"""Flights and drives by hand, in step with the clock."""

import csv
import gzip
import json
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from hashlib import sha256
from math import isnan, nan
from pathlib import Path
from secrets import token_hex
from typing import Any, Final, Protocol

import numpy as np

from pavetwin.app.frame_source import write_frame_source
from pavetwin.app.playback import (
    MINUTE_S,
    AgentSizes,
    bodies,
    defect_values,
    found_values,
    minute,
    minute_file,
    rounded,
    standing_values,
    still_values,
    write_agents,
    write_flight,
    write_playback,
)
from pavetwin.app.requests import StickRequest
from pavetwin.app.session_cache import made_once
from pavetwin.capture.platforms.car import FRONT, REAR
from pavetwin.draw.mission_marks import DefectOutcome
from pavetwin.driving.car import BODY, Pedals
from pavetwin.driving.drive import DefectLooks, Drive, DrivenSegment
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.by_hand import PILOT, STEP_S, ByHand, Stick, changes_as_values
from pavetwin.mission.events import BatteryRanLow, DefectsConfirmed, MissionEvent
from pavetwin.mission.inputs import MissionInputs
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.mission.mission import Traffic
from pavetwin.mission.saving import save_mission
from pavetwin.mission.spec import MissionSpec
from pavetwin.sensing import Sensor, load_sensor
from pavetwin.world.model import Defect

FIRST_MINUTES: Final = 2
"""Initial minutes of traffic; the others follow during the flight."""

PATIENCE_S: Final = 1.5
"""Time without a message after which the stick is released; a held stick is sent repeatedly."""

LATE_S: Final = 1.0
"""Delay behind the clock, after recording traffic, from which the flight continues without catching up."""

TRACK: Final = (
    *("t_s", "x_m", "y_m", "altitude_m", "speed_mps", "yaw_rad", "battery", "visibility", "mode", "segment"),
)
CAPTURES: Final = ("t_s", "x_m", "y_m", "yaw_rad")
"""Columns of a mission that grow; see `pavetwin.app.playback.mission_values`."""


class PilotReport(Protocol):
    """Channel to the pilot: reports of the flight, and messages of the stick."""

    def __call__(self, share: float, what: str, /) -> None: ...

    def ready(self, values: Mapping[str, Any], /) -> None: ...

    def live(self, values: Mapping[str, Any], /) -> None: ...

    def messages(self) -> list[Mapping[str, Any]]:
        """Messages since the last call."""


class LiveVehicle(Protocol):
    """A steered vehicle."""

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
        """Constant data of the mission."""

    def state(self) -> Mapping[str, Any]:
        """Changes of the last step, and the present state."""


def steer_live(vehicle: LiveVehicle, inputs: MissionInputs, session: Path, report: PilotReport) -> None:
    """Continue to the end, with a temporary folder of the session.

    Raises:
        PaveTwinError: it cannot go on.
    """
    inputs.on_extend(lambda share: report(share, "Recording more traffic"))
    with _live_folder(session) as folder:
        _Live(vehicle, inputs, folder, report).run()
        report(1.0, "Preparing to play")


@contextmanager
def _live_folder(session: Path) -> Iterator[Path]:
    folder = session / f"live{token_hex(8)}"
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Live:
    """State of a vehicle for the page, while it moves."""

    def __init__(self, vehicle: LiveVehicle, inputs: MissionInputs, folder: Path, report: PilotReport) -> None:
        self._vehicle, self._inputs, self._folder, self._report_to = vehicle, inputs, folder, report
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
            self._report_to.live({**state, **more})
            step += 1
            behind_s = time.monotonic() - begun_s - step * STEP_S
            if behind_s > LATE_S:
                begun_s += behind_s
            elif behind_s < 0:
                time.sleep(-behind_s)

    def _read_stick(self) -> StickRequest:
        now_s = time.monotonic()
        for values in self._report_to.messages():
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
        self._report_to.ready({**played, "captures": [0], "policies": [self._vehicle.policy]})

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


STICKS: Final = "by-hand.json"


def fly_by_hand(spec: MissionSpec, inputs: MissionInputs, session: Path, report: PilotReport) -> dict[str, Any]:
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
    steer_live(_Uav(flight, sensor), inputs, session, report)
    return _written_flight(flight, spec, inputs, session)


class _Uav:
    """State of the flight for the page, while it lasts."""

    policy = PILOT

    def __init__(self, flight: ByHand, sensor: Sensor) -> None:
        self._flight, self._sensor = flight, sensor
        self._captures = 0
        self._events: Sequence[MissionEvent] = ()

    @property
    def is_over(self) -> bool:
        return self._flight.is_over

    @property
    def time_s(self) -> float:
        return self._flight.duration_s

    @property
    def traffic(self) -> Traffic:
        return self._flight.traffic

    def step(self, stick: StickRequest) -> None:
        self._events = self._flight.step(Stick(**stick.model_dump()), self._sensor)

    def still(self) -> Mapping[str, Any]:
        return still_values(self._flight.environment, self._flight.settings, PILOT, self._flight.sensor)

    def state(self) -> Mapping[str, Any]:
        flight, uav, events = self._flight.flight, self._flight.state(), self._events
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
            "found": [found_values(self._flight.environment.defects[number], flight.time_s) for number in found],
            "is_low": any(isinstance(event, BatteryRanLow) for event in events),
        }


def _written_flight(flight: ByHand, spec: MissionSpec, inputs: MissionInputs, session: Path) -> dict[str, Any]:
    """The flight as the page plays it, its files, and the list of what the pilot did."""
    result = flight.result(spec.seed)
    sticks = {"step_s": STEP_S, "sticks": changes_as_values(flight.changes)}
    known = json.dumps([spec.as_values(), sticks], sort_keys=True)
    key = sha256(known.encode()).hexdigest()[:20]
    target = session / key
    with made_once(target) as made:
        write_playback([result], made, step_s=inputs.replay.recording.step_s)
        write_frame_source([result], made)
        save_mission(result, made / "results")
        (made / "results" / STICKS).write_text(json.dumps(sticks, indent=1), encoding="utf-8")
    results = target / "results"
    names = sorted(path.name for path in results.iterdir() if path.is_file())
    known_as = {"key": key, "captures": [len(result.captures["t_s"])], "policies": [PILOT]}
    return {**known_as, "results": str(results), "names": names}


DRIVER: Final = "by-car"
"""Stands where the name of a policy does."""

LONGEST_S: Final = 3600.0
"""An abandoned drive ends after this time."""

PEDALS: Final = "by-car.json"
SEGMENTS, TRACK_FILE, DEFECTS = "segments.csv", "track.csv", "defects.csv"

STANDS, DRIVES, REVERSES, BLOCKED = range(4)
_MODES: Final = (("stand", "stands"), ("drive", "drives"), ("reverse", "reverses"), ("blocked", "is stopped"))
"""States of the car, in the order of the numbers above."""

GUEST: Final = (
    "The traffic is recorded and does not react: the car is its guest, and others drive through it. The numbers are of "
    "the rear camera, which looks straight down; the front camera is to drive by."
)


def drive_by_hand(spec: MissionSpec, inputs: MissionInputs, session: Path, report: PilotReport) -> dict[str, Any]:
    """Drive until the driver ends it, and write what plays the drive.

    Args:
        spec: whose environment, traffic, sensor and settings hold; the drive begins on the first of its segments.
        session: the folder of the session.

    Raises:
        PaveTwinError: the sensor looks at images, no lane has room for a car, or the drive cannot go on.
    """
    sensor = load_sensor(spec.settings.sensing, spec.seed)
    drive = Drive(inputs.environment, inputs.traffic, spec.settings, sensor, street=next(iter(spec.targets), None))
    steer_live(_Car(drive), inputs, session, report)
    return _written_drive(drive, spec, inputs, session)


class _Car:
    """State of the drive for the page, while it lasts."""

    policy = DRIVER

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._captures = 0
        self._found: Sequence[int] = ()

    @property
    def is_over(self) -> bool:
        return self._drive.is_over

    @property
    def time_s(self) -> float:
        return self._drive.time_s

    @property
    def traffic(self) -> Traffic:
        return self._drive.traffic

    def step(self, stick: StickRequest) -> None:
        ends = stick.lands or self.time_s > LONGEST_S
        pedals = Pedals(ahead=stick.ahead, left=stick.turn, is_fast=stick.is_fast, ends=ends)
        self._found = self._drive.step(pedals)

    def still(self) -> Mapping[str, Any]:
        return _still_drive(self._drive)

    def state(self) -> Mapping[str, Any]:
        drive, car = self._drive, self._drive.state
        new = drive.captures[self._captures :]
        self._captures = len(drive.captures)
        visibility, defects = drive.looks[-1], drive.environment.defects
        segments = drive.environment.world.segments
        captures = zip(*((each.time_s, each.x_m, each.y_m, each.yaw_rad) for each in new), strict=True)
        columns = [[round(value, 4) for value in column] for column in captures] or [[]] * len(CAPTURES)
        return {
            "t_s": round(drive.time_s, 3),
            "place_m": [round(car.x_m, 3), round(car.y_m, 3)],
            "altitude_m": REAR.z_m,
            "yaw_rad": round(car.yaw_rad, 4),
            "speed_mps": round(abs(car.speed_mps), 3),
            "battery": None,
            "mode": _mode(car.speed_mps, is_blocked=drive.is_blocked),
            "visibility": None if visibility is None else round(visibility, 4),
            "segment": None if drive.below is None else segments[drive.below].id,
            "coverage": {name: round(share, 4) for name, share in drive.coverage().items()},
            "captures": dict(zip(CAPTURES, columns, strict=True)),
            "found": [found_values(defects[number], drive.time_s) for number in self._found],
            "is_met": drive.is_met,
        }


def _mode(speed_mps: float, *, is_blocked: bool) -> int:
    if is_blocked:
        return BLOCKED
    return DRIVES if speed_mps > 0 else REVERSES if speed_mps < 0 else STANDS


def _still_drive(drive: Drive) -> dict[str, Any]:
    """Constant data of a drive."""
    window = [round(each, 3) for each in drive.camera.window_m(REAR.z_m)]
    return {
        "policy": DRIVER,
        "sensor": drive.sensor.name,
        "altitude_m": REAR.z_m,
        "threshold": drive.settings.visibility.threshold,
        "window_m": window,
        "footprint_m": window,
        "modes": [{"name": name, "words": words} for name, words in _MODES],
        "car": {
            "length_m": BODY.length_m,
            "width_m": BODY.width_m,
            "height_m": BODY.height_m,
            "camera_ahead_m": REAR.x_m,
            "front": {
                "ahead_m": FRONT.x_m,
                "up_m": FRONT.z_m,
                "pitch_rad": FRONT.pitch_rad,
                "fov_deg": FRONT.camera.vertical_fov_deg,
            },
        },
        **standing_values(drive.environment),
    }


def _written_drive(drive: Drive, spec: MissionSpec, inputs: MissionInputs, session: Path) -> dict[str, Any]:
    """The drive as the page plays it, its files, and the list of what the driver did."""
    pedals = {"step_s": STEP_S, "limits": asdict(drive.limits), "pedals": changes_as_values(drive.changes)}
    known = json.dumps([spec.as_values(), pedals], sort_keys=True)
    key = sha256(known.encode()).hexdigest()[:20]
    target = session / key
    with made_once(target) as made:
        results = made / "results"
        results.mkdir()
        rows, defects = drive.rows(), list(_defects(drive))
        agents = write_agents(drive.traffic.trace(), made, step_s=inputs.replay.recording.step_s, until_s=drive.time_s)
        write_flight({**agents, **_played(drive, rows, defects)}, made)
        (results / PEDALS).write_text(json.dumps(pedals, indent=1), encoding="utf-8")
        _write_table(results / SEGMENTS, map(asdict, rows))
        _write_table(results / TRACK_FILE, _track_rows(drive))
        flat = (
            {name: value for name, value in each.items() if name not in ("place_m", "hidden_by")} for each in defects
        )
        _write_table(results / DEFECTS, flat)
    names = sorted(path.name for path in (target / "results").iterdir())
    known_as = {"key": key, "captures": [0], "policies": [DRIVER]}
    return {**known_as, "results": str(target / "results"), "names": names}


def _played(drive: Drive, rows: Sequence[DrivenSegment], defects: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    states, captures, looks = drive.states, drive.captures, drive.looks
    indices = {segment.id: index for index, segment in enumerate(drive.environment.world.segments)}
    last = {"t_s": round(drive.time_s, 3), "kind": "finish"}
    mission = {
        **_still_drive(drive),
        "duration_s": round(drive.time_s, 3),
        "targets": [row.segment for row in rows],
        "track": {
            "t_s": rounded(np.arange(len(states)) * STEP_S, 3),
            "x_m": rounded([each.x_m for each in states], 3),
            "y_m": rounded([each.y_m for each in states], 3),
            "altitude_m": [REAR.z_m] * len(states),
            "speed_mps": rounded([abs(each.speed_mps) for each in states], 3),
            "yaw_rad": rounded(np.unwrap([each.yaw_rad for each in states]), 4),
            "battery": [None] * len(states),
            "visibility": [None if each is None else round(each, 4) for each in looks],
            "mode": [_mode(state.speed_mps, is_blocked=stop) for state, stop in zip(states, drive.stops, strict=True)],
            "segment": [-1] * len(states),
        },
        "captures": {
            **{name: rounded([getattr(each, name) for each in captures], 3) for name in ("x_m", "y_m")},
            "t_s": rounded([each.time_s for each in captures], 3),
            "yaw_rad": rounded([each.yaw_rad for each in captures], 4),
            "visibility": [None if each.visibility is None else round(each.visibility, 4) for each in captures],
            "segment": [each.segment for each in captures],
        },
        "events": [*_occlusions(drive), *({**last, "segment": row.segment} for row in rows if row.segment in indices)],
        "defects": list(defects),
    }
    shown = [{"of": "segments", "columns": _columns(rows)}] if rows else []
    return {"missions": [mission], "tables": shown, "sentence": _sentence(drive, rows), "remarks": [GUEST]}


def _occlusions(drive: Drive) -> Iterable[dict[str, Any]]:
    """The moments at which o falls below the threshold."""
    was_hidden = False
    for step, look in enumerate(drive.looks):
        is_hidden = look is not None and look < drive.settings.visibility.threshold
        if is_hidden and not was_hidden and look is not None:
            yield {"t_s": round(step * STEP_S, 3), "kind": "occlusion", "visibility": round(look, 4)}
        was_hidden = is_hidden


def _defects(drive: Drive) -> Iterable[dict[str, Any]]:
    """Every defect of the segments that the camera saw: found, or missed and why."""
    environment, least = drive.environment, drive.settings.sensing.min_visible_fraction
    for row in drive.rows():
        for number in environment.defects_by_segment.get(row.segment, ()):
            defect, looks = environment.defects[number], drive.looks_at.get(number, DefectLooks())
            if number in drive.confirmed:
                yield {**found_values(defect, drive.confirmed[number]), "visible": round(looks.visible, 3)}
            else:
                yield _missed(defect, looks, looks.reason(least))


def _missed(defect: Defect, looks: DefectLooks, reason: MissReason) -> dict[str, Any]:
    is_parked = reason is MissReason.HIDDEN_BY_PARKED_VEHICLES
    return {
        **defect_values(defect),
        "outcome": (DefectOutcome.BEHIND_PARKED if is_parked else DefectOutcome.MISSED).value,
        "found_s": None,
        "visible": round(looks.visible, 3),
        "reason": reason.words,
        "captures": looks.captures,
        "time_s": None if looks.time_s is None else round(looks.time_s, 3),
        "hidden_by": {each.words: round(share, 3) for each, share in looks.hidden_by().items()},
    }


def _columns(rows: Sequence[DrivenSegment]) -> list[dict[str, Any]]:
    """The table of the page, as `pavetwin.mission.summary` makes that of a mission."""
    area_m2 = sum(row.area_m2 for row in rows)
    seen = sum(row.surface_coverage * row.area_m2 for row in rows) / area_m2
    defects, found = sum(row.defects for row in rows), sum(row.found for row in rows)
    alarms = sum(row.false_alarms for row in rows)
    columns = [
        ("segment", [row.segment for row in rows], f"{len(rows)}"),
        ("street", [row.street for row in rows], ""),
        ("length\nm", [f"{row.length_m:.0f}" for row in rows], f"{sum(row.length_m for row in rows):.0f}"),
        ("defects\nfound", [f"{row.found}/{row.defects}" for row in rows], f"{found}/{defects}"),
        ("surface\nseen %", [f"{100 * row.surface_coverage:.1f}" for row in rows], f"{100 * seen:.1f}"),
        ("false\nalarms", [f"{row.false_alarms}" for row in rows], f"{alarms}"),
    ]
    return [
        {"heading": heading, "cells": cells, "total": total, "is_left": heading in ("segment", "street"), "best": []}
        for heading, cells, total in columns
    ]


def _sentence(drive: Drive, rows: Sequence[DrivenSegment]) -> str:
    defects, found = sum(row.defects for row in rows), sum(row.found for row in rows)
    what = f"{found} of {defects} defects found" if defects else "No defects to find"
    users = "road user" if drive.meetings == 1 else "road users"
    met = f", {drive.meetings} recorded {users} met" if drive.meetings else ""
    return f"{what} on {drive.distance_m:.0f} m, driven in {drive.time_s / 60:.1f} min{met}."


def _track_rows(drive: Drive) -> Iterable[dict[str, Any]]:
    places = np.array([(each.x_m, each.y_m) for each in drive.states])
    lonlat = drive.environment.world.georeference.to_wgs84(places)
    for step, (state, look, (lon, lat)) in enumerate(zip(drive.states, drive.looks, lonlat.tolist(), strict=True)):
        yield {
            "t_s": round(step * STEP_S, 3),
            **{name: round(value, 5) for name, value in asdict(state).items()},
            "longitude": round(lon, 8),
            "latitude": round(lat, 8),
            "visibility": None if look is None else round(look, 4),
        }


def _write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Rows as CSV; no file where there is none."""
    listed = list(rows)
    if not listed:
        return
    names = list(dict.fromkeys(name for row in listed for name in row))
    with writing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(listed)
