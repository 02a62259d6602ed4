"""CSV files of waypoints: Litchi's, and a plain table for any other program.

Litchi publishes no description: columns and codes are those of files that its Mission Hub exports (actions 5: tilt the
camera; gimbal mode 2: interpolate; altitude mode 0: above take-off; −1: no interval)."""

import csv
import io
from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.flightplan.flight_plan import STRAIGHT_DOWN_DEG, FlightPlan, PlannedFlight, Trigger
from pavetwin.flightplan.formats.plan_files import PlanFormat, is_last, number_text, plan_format

ACTIONS: Final = 15
"""Number of actions per waypoint, each with a parameter."""
NO_ACTION, TILT_CAMERA = -1, 5
INTERPOLATE: Final = 2
ABOVE_TAKE_OFF: Final = 0
OFF: Final = -1

LEAST_INTERVAL_S: Final = 1.0
"""Least time between photographs."""

COLUMNS: Final = (
    *("latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir"),
    *("gimbalmode", "gimbalpitchangle"),
    *(f"action{what}{number}" for number in range(1, ACTIONS + 1) for what in ("type", "param")),
    *("altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode"),
    *("photo_timeinterval", "photo_distinterval"),
)


@plan_format("litchi")
class Litchi(PlanFormat):
    """Litchi's CSV."""

    suffix = "-litchi.csv"
    most_waypoints = 99

    def write(self, plan: FlightPlan, flight: PlannedFlight) -> bytes:
        if plan.trigger is Trigger.TIME and plan.interval_s < LEAST_INTERVAL_S:
            raise PaveTwinError(
                f"`trigger` time: the mission photographs every {plan.interval_s:g} s, and Litchi every "
                f"{LEAST_INTERVAL_S:g} s at most often; use `trigger` distance, or another format."
            )
        file = io.StringIO()
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(COLUMNS)
        down = number_text(STRAIGHT_DOWN_DEG)
        for each, heading_deg in zip(flight.waypoints, flight.headings_deg, strict=True):
            on = each.photographs and not is_last(flight, each)
            by_time, by_distance = (on and plan.trigger is trigger for trigger in (Trigger.TIME, Trigger.DISTANCE))
            first = each is flight.home
            actions = [TILT_CAMERA if first else NO_ACTION, down if first else 0, *[NO_ACTION, 0] * (ACTIONS - 1)]
            rows.writerow(
                [
                    *(f"{each.latitude:.8f}", f"{each.longitude:.8f}", number_text(each.height_m)),
                    *(f"{heading_deg:.1f}", number_text(each.corner_m), 0, INTERPOLATE, down),
                    *actions,
                    *(ABOVE_TAKE_OFF, number_text(each.speed_mps), 0, 0, 0, 0),
                    number_text(plan.interval_s) if by_time else OFF,
                    number_text(round(plan.spacing_m, 3)) if by_distance else OFF,
                ]
            )
        return file.getvalue().encode()


@plan_format("csv")
class WaypointTable(PlanFormat):
    """A plain table with one row per waypoint; `docs/how-to/fly-a-plan.md` lists its columns."""

    suffix = ".csv"

    def write(self, plan: FlightPlan, flight: PlannedFlight) -> bytes:
        file = io.StringIO()
        rows = csv.writer(file, lineterminator="\n")
        every = "every_m" if plan.trigger is Trigger.DISTANCE else "every_s"
        rows.writerow(
            ["waypoint", "longitude", "latitude", "height_m", "speed_mps", "heading_deg", "gimbal_pitch_deg"]
            + ["corner_m", "photographs", every, "segment"]
        )
        value = plan.spacing_m if plan.trigger is Trigger.DISTANCE else plan.interval_s
        for number, (each, heading_deg) in enumerate(zip(flight.waypoints, flight.headings_deg, strict=True), 1):
            on = each.photographs and not is_last(flight, each)
            rows.writerow(
                [number, f"{each.longitude:.8f}", f"{each.latitude:.8f}", number_text(each.height_m)]
                + [number_text(each.speed_mps), f"{heading_deg:.1f}", number_text(STRAIGHT_DOWN_DEG)]
                + [number_text(each.corner_m), "yes" if on else "no", number_text(round(value, 3)) if on else ""]
                + [each.segment or ""]
            )
        return file.getvalue().encode()
