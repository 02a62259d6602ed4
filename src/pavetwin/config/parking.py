"""Whether parked vehicles stand in a world's parking places, and how many."""

from typing import Annotated

from pydantic import Field

from pavetwin.config.base import Settings


class ParkingSettings(Settings):
    """Parked vehicles of a mission."""

    enabled: bool = True
    """Vehicles stand in the parking places."""
    occupancy: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the places that are taken; null: the daily curve for type of street, day of the week and time."""
