"""QGroundControl's `.plan`: JSON with MAVLink commands, for PX4 and ArduPilot.

The structure is that of "Plan File Format" in QGroundControl's developer guide; commands and their parameters are
MAVLink's (common message set).
"""

import json
from collections.abc import Iterator
from typing import Any, Final

from pavetwin.flightplan.flight_plan import STRAIGHT_DOWN_DEG, FlightPlan, PlannedFlight, Trigger, Waypoint
from pavetwin.flightplan.formats.plan_files import PlanFormat, plan_format

PX4: Final = 12
"""MAV_AUTOPILOT_PX4."""
QUADROTOR: Final = 2
"""MAV_TYPE_QUADROTOR."""

WAYPOINT, LAND, TAKE_OFF = 16, 21, 22
CHANGE_SPEED, AIM_GIMBAL, TRIGGER_DISTANCE = 178, 205, 206
START_CAPTURE, STOP_CAPTURE = 2000, 2001

MISSION_FRAME, RELATIVE_FRAME = 2, 3
"""MAV_FRAME_MISSION for commands without a place, and MAV_FRAME_GLOBAL_RELATIVE_ALT (above the take-off point)."""

AIM_BY_ANGLES: Final = 2
"""MAV_MOUNT_MODE_MAVLINK_TARGETING."""

PASSED_M: Final = 0.5
"""Acceptance radius of waypoints with a stop."""

STOP_S: Final = 1.0
"""Hold time at those waypoints: without it the autopilot turns once it is within the radius."""

ABOVE_TAKE_OFF: Final = 1
"""QGroundControl's altitude mode."""


@plan_format("qgc")
class QGroundControl(PlanFormat):
    """QGroundControl's `.plan`."""

    suffix = ".plan"

    def write(self, plan: FlightPlan, flight: PlannedFlight) -> bytes:
        items = [each | {"doJumpId": number} for number, each in enumerate(_items(plan, flight), 1)]
        home = flight.home
        document = {
            "fileType": "Plan",
            "version": 1,
            "groundStation": "QGroundControl",
            "mission": {
                "version": 2,
                "firmwareType": PX4,
                "vehicleType": QUADROTOR,
                "cruiseSpeed": max(each.speed_mps for each in flight.waypoints),
                "hoverSpeed": min(each.speed_mps for each in flight.waypoints),
                "plannedHomePosition": [home.latitude, home.longitude, 0],
                "items": items,
            },
            "geoFence": {"version": 2, "circles": [], "polygons": []},
            "rallyPoints": {"version": 2, "points": []},
        }
        return (json.dumps(document, indent=1) + "\n").encode()


def _items(plan: FlightPlan, flight: PlannedFlight) -> Iterator[dict[str, Any]]:
    first, last = flight.home, flight.waypoints[-1]
    yield _at(TAKE_OFF, [0, 0, 0, None], first, first.height_m)
    yield _command(AIM_GIMBAL, [STRAIGHT_DOWN_DEG, 0, 0, 0, 0, 0, AIM_BY_ANGLES])
    speed_mps, photographs = None, False
    for each in flight.waypoints:
        hold_s = 0.0 if each.corner_m else STOP_S
        yield _at(WAYPOINT, [hold_s, each.corner_m or PASSED_M, 0, None], each, each.height_m)
        if each is not last and each.speed_mps != speed_mps:
            speed_mps = each.speed_mps
            yield _command(CHANGE_SPEED, [1, speed_mps, -1, 0, 0, 0, 0])
        if each.photographs != photographs:
            photographs = each.photographs
            yield _shutter(plan, on=photographs)
    yield _at(LAND, [0, 0, 0, None], last, 0)


def _shutter(plan: FlightPlan, *, on: bool) -> dict[str, Any]:
    if plan.trigger is Trigger.DISTANCE:
        return _command(TRIGGER_DISTANCE, [round(plan.spacing_m, 3) if on else 0, 0, int(on), 0, 0, 0, 0])
    return _command(*(START_CAPTURE, [0, plan.interval_s, 0, 0, 0, 0, 0]) if on else (STOP_CAPTURE, [0] * 7))


def _at(command: int, parameters: list[float | None], place: Waypoint, height_m: float) -> dict[str, Any]:
    """A command with a place; parameter 4, None, leaves the heading to the autopilot: along the path."""
    there = [place.latitude, place.longitude, height_m]
    heights = {"AMSLAltAboveTerrain": None, "Altitude": height_m, "AltitudeMode": ABOVE_TAKE_OFF}
    return heights | _simple(command, RELATIVE_FRAME, [*parameters, *there])


def _command(command: int, parameters: list[float]) -> dict[str, Any]:
    return _simple(command, MISSION_FRAME, parameters)


def _simple(command: int, frame: int, parameters: list[Any]) -> dict[str, Any]:
    return {"type": "SimpleItem", "autoContinue": True, "command": command, "frame": frame, "params": parameters}
