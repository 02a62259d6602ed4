"""Plans that a real drone flies, from simulated missions: their legs, their limits, their files."""

from pavetwin.flightplan.formats import PLAN_FORMATS, PlanFormat, plan_format
from pavetwin.flightplan.limits import PlanLimits, check_limits
from pavetwin.flightplan.model import FlightPlan, PlannedFlight, Trigger, Waypoint
from pavetwin.flightplan.of_mission import plan_of
from pavetwin.flightplan.of_selection import plan_of_selection
from pavetwin.flightplan.save import save_plan

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
