"""A plain table of waypoints, for any other program."""

import csv
import io

from pavetwin.flightplan.formats.base import PlanFormat, is_last, number_text, plan_format
from pavetwin.flightplan.model import STRAIGHT_DOWN_DEG, FlightPlan, PlannedFlight, Trigger


@plan_format("csv")
class WaypointTable(PlanFormat):
    """A plain table, a row for each waypoint; `docs/how-to/fly-a-plan.md` names its columns."""

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
