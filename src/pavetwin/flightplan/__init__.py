"""Plans that a real drone flies, from simulated missions: their legs, their limits, their files."""

from pavetwin.flightplan.flight_plan import FlightPlan, PlannedFlight, Trigger, Waypoint
from pavetwin.flightplan.formats import PLAN_FORMATS, PlanFormat, plan_format
from pavetwin.flightplan.formats.plan_files import save_plan
from pavetwin.flightplan.limits import PlanLimits, check_limits
from pavetwin.flightplan.of_mission import plan_of, plan_of_selection

__all__ = [
    "PLAN_FORMATS",
    "FlightPlan",
    "PlanFormat",
    "PlanLimits",
    "PlannedFlight",
    "Trigger",
    "Waypoint",
    "check_limits",
    "plan_format",
    "plan_of",
    "plan_of_selection",
    "save_plan",
]
