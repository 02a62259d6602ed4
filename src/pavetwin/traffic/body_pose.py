"""From SUMO's poses to those of recordings.

SUMO gives a vehicle's front bumper and a heading in degrees clockwise from north; a recording holds the body's centre
on the ground and a yaw in radians counter-clockwise from east.
"""

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array


def yaw_of_heading(heading_deg: npt.ArrayLike) -> Float64Array:
    """Degrees clockwise from north to radians counter-clockwise from east, in −π … π."""
    turned = np.radians(90.0 - np.asarray(heading_deg, dtype=np.float64))
    yaw: Float64Array = np.arctan2(np.sin(turned), np.cos(turned))
    return yaw


def centre_of_front(front: npt.ArrayLike, yaw_rad: npt.ArrayLike, length_m: npt.ArrayLike) -> Float64Array:
    """The centres (..., 2) of bodies whose front bumpers' middles are `front` (..., 2), in metres."""
    yaw, half = np.asarray(yaw_rad, dtype=np.float64), np.asarray(length_m, dtype=np.float64)[..., np.newaxis] / 2
    centre: Float64Array = np.asarray(front, dtype=np.float64) - half * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    return centre
