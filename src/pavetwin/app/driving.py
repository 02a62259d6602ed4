"""Driving the survey car by hand for the page, as `pavetwin.app.live_loop` steers it.

Afterwards the drive is played like a flight: track, captures, defects and a table, with the car in place of the UAV. It
is no mission: what it wrote, and the list of what the driver did, are in the session's folder.
"""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np

from pavetwin.app.live_loop import CAPTURES, PilotReport, steer_live
from pavetwin.app.made_once import made_once
from pavetwin.app.playback import (
    defect_values,
    found_values,
    rounded,
    standing_values,
    write_agents,
    write_flight,
)
from pavetwin.app.requests import StickRequest
from pavetwin.capture.platforms.car import FRONT, REAR
from pavetwin.draw.marks import DefectOutcome
from pavetwin.driving.car import BODY, Pedals
from pavetwin.driving.drive import DefectLooks, Drive, DrivenSegment, pedals_as_values
from pavetwin.files import writing
from pavetwin.mission.by_hand import STEP_S
from pavetwin.mission.inputs import MissionInputs
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.mission.mission import Traffic
from pavetwin.mission.spec import MissionSpec
from pavetwin.sensing import load_sensor
from pavetwin.world.model import Defect

DRIVER: Final = "by-car"
"""Stands where the name of a policy does."""

LONGEST_S: Final = 3600.0
"""A drive ends by itself after this long: it is forgotten."""

PEDALS: Final = "by-car.json"
SEGMENTS, TRACK, DEFECTS = "segments.csv", "track.csv", "defects.csv"

STANDS, DRIVES, REVERSES, BLOCKED = range(4)
_MODES: Final = (("stand", "stands"), ("drive", "drives"), ("reverse", "reverses"), ("blocked", "is stopped"))
"""What the car does, in the order of the numbers above."""

GUEST: Final = (
    "The traffic is recorded and does not react: the car is its guest, and others drive through it. The numbers are of "
    "the rear camera, which looks straight down; the front camera is to drive by."
)


def drive_by_hand(spec: MissionSpec, inputs: MissionInputs, session: Path, tell: PilotReport) -> dict[str, Any]:
    """Drive until the driver ends it, and write what plays the drive.

    Args:
        spec: whose environment, traffic, sensor and settings hold; the drive begins on the first of its segments.
        session: the folder of the session.

    Raises:
        PaveTwinError: the sensor looks at images, no lane has room for a car, or the drive cannot go on.
    """
    sensor = load_sensor(spec.settings.sensing, spec.seed)
    drive = Drive(inputs.environment, inputs.traffic, spec.settings, sensor, street=next(iter(spec.targets), None))
    steer_live(_Car(drive), inputs, session, tell)
    return _written(drive, spec, inputs, session)


class _Car:
    """The drive as the page sees it while it goes on."""

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
        return _still(self._drive)

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


def _still(drive: Drive) -> dict[str, Any]:
    """What of a drive does not change."""
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


def _written(drive: Drive, spec: MissionSpec, inputs: MissionInputs, session: Path) -> dict[str, Any]:
    """The drive as the page plays it, its files, and the list of what the driver did."""
    pedals = {"step_s": STEP_S, "limits": asdict(drive.limits), "pedals": pedals_as_values(drive.changes)}
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
        _write_table(results / TRACK, _track_rows(drive))
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
        **_still(drive),
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
