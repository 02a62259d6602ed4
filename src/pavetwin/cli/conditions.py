"""Options for the date, the time of day and the weather of a mission."""

import re
from typing import Annotated, Any, Final

import typer

from pavetwin.errors import PaveTwinError

Date = Annotated[
    str | None,
    typer.Option(metavar="YYYY-MM-DD", help="Date of the flight, for parked vehicles and the light of frames."),
]
Time = Annotated[
    str | None, typer.Option(metavar="HH:MM", help="Time of day at take-off: mean solar time at the world's base.")
]
Clouds = Annotated[float | None, typer.Option(metavar="0…1", help="Cloud cover: 0 clear, 1 overcast.")]
Wind = Annotated[
    str | None,
    typer.Option(metavar="SPEED[@FROM]", help="Wind in m/s, and the direction it comes from in degrees: 5@270."),
]

OPTIONS: Final = ("date", "time", "clouds", "wind")
"""Their names."""

_WIND: Final = re.compile(r"(?P<speed>\d+(\.\d*)?)(@(?P<from>\d+(\.\d*)?))?")


def conditions_of(date: str | None, time: str | None, clouds: float | None, wind: str | None) -> dict[str, Any]:
    """Values for the settings' `conditions`; without those that were not given.

    Raises:
        PaveTwinError: a value does not fit; the message names its option.
    """
    values: dict[str, Any] = {}
    for option, text, given in (
        ("date", date, {"date": date}),
        ("time", time, {"time": time}),
        ("clouds", clouds, {"clouds": clouds}),
        ("wind", wind, {} if wind is None else _wind(wind)),
    ):
        if text is not None:
            values |= _checked(option, text, given)
    return values


def _wind(text: str) -> dict[str, Any]:
    parts = _WIND.fullmatch(text)
    if parts is None:
        raise PaveTwinError(
            f"--wind {text}: expected metres a second, or with the direction it comes from, as in 5@270."
        )
    direction = {} if parts["from"] is None else {"wind_from_deg": float(parts["from"])}
    return {"wind_mps": float(parts["speed"]), **direction}


def _checked(option: str, text: object, given: dict[str, Any]) -> dict[str, Any]:
    from pydantic import ValidationError

    from pavetwin.config import Conditions
    from pavetwin.config.settings import complaint

    try:
        Conditions.model_validate(given)
    except ValidationError as error:
        raise PaveTwinError(f"--{option} {text}: {complaint(error)}.") from error
    return given
