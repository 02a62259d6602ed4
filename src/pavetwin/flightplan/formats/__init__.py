"""Files of flight plans for the programs that fly them. One file per format, one registry."""

from pavetwin.flightplan.formats.plan_files import PLAN_FORMATS, PlanFormat, plan_format

__all__ = ["PLAN_FORMATS", "PlanFormat", "plan_format"]
