"""What a format of flight plans is, and where formats are registered."""

from abc import ABC, abstractmethod
from typing import ClassVar

from pavetwin.flightplan.model import FlightPlan, PlannedFlight, Waypoint
from pavetwin.registry import Registry


class PlanFormat(ABC):
    """One format: a file for each flight, or several where a flight has more waypoints than a file may hold."""

    suffix: ClassVar[str]
    """The end of the file's name, its dot included."""
    most_waypoints: ClassVar[int | None] = None
    """That a file may hold; a flight with more is written in parts."""

    def __init__(self, drone: str | None = None) -> None:
        """Args:
        drone: name of the aircraft, for formats that need to know it.
        """
        self.drone = drone

    @abstractmethod
    def write(self, plan: FlightPlan, flight: PlannedFlight) -> bytes:
        """The file of one flight, which has no more waypoints than it may hold."""


PLAN_FORMATS: Registry[type[PlanFormat]] = Registry(
    "format of flight plans", key="format", group="pavetwin.plan_formats", home="pavetwin.flightplan.formats"
)
plan_format = PLAN_FORMATS.register
"""Register a format under a name, which `pavetwin plan export --format` then takes."""


def number_text(value: float) -> str:
    """Without an exponent and without zeros at the end."""
    return f"{value:.8f}".rstrip("0").rstrip(".")


def is_last(flight: PlannedFlight, waypoint: Waypoint) -> bool:
    """Whether a waypoint is that with which a flight ends."""
    return waypoint is flight.waypoints[-1]
