"""The speed limit at any place of a world's streets. Imports little, since the simulation's process needs it."""

from typing import TYPE_CHECKING, Final, Self

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array

if TYPE_CHECKING:
    from pavetwin.world.model import World

SPACING_M: Final = 4.0
"""Between the points of a lane's centre line that stand for it."""

TURNED_M: Final = 12.0
"""A lane in the opposite direction counts as twice this much farther away."""


class SpeedLimits:
    """The speed limit at places of a world, by direction of travel."""

    def __init__(self, places: Float64Array, limits: Float64Array) -> None:
        """
        Args:
            places: (n, 4) as of `_key`.
            limits: (n,) metres per second.
        """
        from scipy.spatial import cKDTree  # takes long to import

        self.places, self.limits = places, limits
        self._tree = cKDTree(places)

    @classmethod
    def of(cls, world: "World") -> Self:
        from pavetwin.world.model import LaneKind

        points, limits = [np.zeros((0, 4))], [np.zeros(0)]
        for lane in world.lanes_of(LaneKind.DRIVING):
            at_m = np.linspace(0.0, lane.length_m, max(2, int(lane.length_m / SPACING_M) + 1))
            line = np.asarray(lane.centre_line.coords)[:, :2]
            along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            xy = np.stack([np.interp(at_m, along_m, line[:, axis]) for axis in (0, 1)], axis=-1)
            ahead = np.gradient(xy, axis=0)
            points.append(_key(xy[:, 0], xy[:, 1], np.arctan2(ahead[:, 1], ahead[:, 0])))
            limits.append(np.full(len(at_m), lane.speed_limit_mps))
        return cls(np.concatenate(points), np.concatenate(limits))

    def __reduce__(self) -> tuple[type[Self], tuple[Float64Array, Float64Array]]:
        return type(self), (self.places, self.limits)

    def __bool__(self) -> bool:
        """Whether the world has lanes."""
        return len(self.limits) > 0

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike, yaw_rad: npt.ArrayLike) -> Float64Array:
        """Metres per second at places (n,) of the world's frame, headed by `yaw_rad` counter-clockwise from east."""
        nearest = self._tree.query(_key(x, y, yaw_rad))[1]
        limits: Float64Array = self.limits[nearest]
        return limits


def _key(x: npt.ArrayLike, y: npt.ArrayLike, yaw_rad: npt.ArrayLike) -> Float64Array:
    """(n, 4): what is near in place and direction is near here."""
    yaw = np.asarray(yaw_rad, dtype=np.float64)
    key: Float64Array = np.stack(
        [np.asarray(x, np.float64), np.asarray(y, np.float64), TURNED_M * np.cos(yaw), TURNED_M * np.sin(yaw)], axis=-1
    )
    return key
