"""Whether parked vehicles stand in a world's parking places, and how many."""

from typing import Annotated, Any

from pydantic import Field, model_validator

from pavetwin.config.base import Settings


class ParkingSettings(Settings):
    """Parked vehicles of a mission."""

    enabled: bool = False
    """False: all places are empty. Unless given, true where `occupancy` is: off by default, since recorded traffic does
    not keep clear of parked vehicles yet."""
    occupancy: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the places that are taken; null: by the daily curve for the type of street, the day of the week and the
    time (`pavetwin.traffic.occupancy`)."""

    @model_validator(mode="before")
    @classmethod
    def _asked_for(cls, values: Any) -> Any:
        """A share of the places asks for parked vehicles."""
        if isinstance(values, dict) and values.get("occupancy") is not None:
            return {"enabled": True, **values}
        return values
