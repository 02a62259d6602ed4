"""Flying by hand for the page: the UAV as `pavetwin.app.live_loop` steers it.

Afterwards the flight is played as any other. It is no mission of the world: its files, and the list of what the pilot
did, are in the session's folder.
"""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from math import isnan, nan
from pathlib import Path
from typing import Any, Final

from pavetwin.app.frame_source import write_frame_source
from pavetwin.app.live_loop import CAPTURES, PilotReport, steer_live
from pavetwin.app.made_once import made_once
from pavetwin.app.playback import found_values, still_values, write_playback
from pavetwin.app.requests import StickRequest
from pavetwin.errors import PaveTwinError
from pavetwin.mission.by_hand import PILOT, STEP_S, ByHand, Stick, sticks_as_values
from pavetwin.mission.events import BatteryRanLow, DefectsConfirmed, MissionEvent
from pavetwin.mission.inputs import MissionInputs
from pavetwin.mission.mission import Traffic
from pavetwin.mission.saving import save_mission
from pavetwin.mission.spec import MissionSpec
from pavetwin.sensing import Sensor, load_sensor

STICKS: Final = "by-hand.json"


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
    steer_live(_Uav(flight, sensor), inputs, session, tell)
    return _written(flight, spec, inputs, session)


class _Uav:
    """The flight as the page sees it while it goes on."""

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


def _written(flight: ByHand, spec: MissionSpec, inputs: MissionInputs, session: Path) -> dict[str, Any]:
    """The flight as the page plays it, its files, and the list of what the pilot did."""
    result = flight.result(spec.seed)
    sticks = {"step_s": STEP_S, "sticks": sticks_as_values(flight.changes)}
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
