"""The option for parked vehicles."""

from typing import Annotated, Any

import typer

from pavetwin.errors import PaveTwinError

Parking = Annotated[
    str | None,
    typer.Option(
        metavar="SHARE|by-time|none",
        help="Share of occupied parking places, 0…1; by-time: by the daily curve of the date and time; or none. "
        "Default: by-time; none with the preset paper and in exports.",
    ),
]


def parking_of(text: str) -> dict[str, Any]:
    """Parse values for the settings' `parking`.

    Raises:
        PaveTwinError: the text is neither `none`, `by-time` nor a share.
    """
    if text == "none":
        return {"enabled": False}
    if text == "by-time":
        return {"enabled": True, "occupancy": None}
    try:
        share = float(text)
    except ValueError:
        share = -1.0
    if not 0 <= share <= 1:
        raise PaveTwinError(f"--parking {text}: expected a share of the places (0 to 1), by-time, or none.")
    return {"enabled": True, "occupancy": share}
