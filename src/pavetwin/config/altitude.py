"""How high the UAV may fly: one rule for missions, studies, images and NavMeshes."""

from typing import Annotated, Final

from pydantic import AfterValidator

from pavetwin.errors import PaveTwinError

VERTICAL_CLEARANCE_M: Final = 1.0
"""Kept above and below the UAV: whatever reaches into altitude ± this is an obstacle."""

TALLEST_VEHICLE_M: Final = 4.0
"""What Council Directive 96/53/EC allows on the road; the recorded traffic knows of no UAV and gives no way."""

LOWEST_M: Final = TALLEST_VEHICLE_M + VERTICAL_CLEARANCE_M

CEILING_M: Final = 120.0
"""Of the open category in the EU, (EU) 2019/947; 14 CFR 107.51 has 400 ft, 122 m."""


def checked_altitude(altitude_m: float) -> float:
    """The altitude, if the UAV may fly there.

    Raises:
        ValueError: it is too low or too high, or no number; the message says why, without naming the value.
    """
    if not altitude_m >= LOWEST_M:
        raise ValueError(
            f"the UAV flies at {LOWEST_M:g} m or higher, {VERTICAL_CLEARANCE_M:g} m clear of vehicles of up to "
            f"{TALLEST_VEHICLE_M:g} m; choose a higher altitude"
        )
    if altitude_m > CEILING_M:
        raise ValueError(
            f"the UAV flies at {CEILING_M:g} m or lower, the legal ceiling in the EU and the US; choose a lower "
            "altitude"
        )
    return altitude_m


def check_altitude(altitude_m: float) -> None:
    """Look whether the UAV may fly there.

    Raises:
        PaveTwinError: it may not; the message names the parameter.
    """
    try:
        checked_altitude(altitude_m)
    except ValueError as error:
        raise PaveTwinError(f"`altitude_m` {altitude_m:g}: {error}.") from error


Altitude = Annotated[float, AfterValidator(checked_altitude)]
"""Of settings, in metres."""
