"""Height of the ground: the carriageway at 0, a kerb around it, the land behind at the kerb's height."""

from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array, GeometryArray
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout

KERB_M: Final = 0.12
"""Height of a kerb; 10 to 15 cm are usual (RASt 06: 12 cm)."""

KERB_WIDTH_M: Final = 0.15
"""Width of kerb units (EN 1340: 150 mm)."""

PROFILE: Final = ((0.0, 0.0, 0.0), (0.012, 0.80, 0.097), (0.034, 0.985, 0.128), (KERB_WIDTH_M, 1.0, 0.244))
"""A kerb's section with its rounded edge: distance from the carriageway [m], share of the height, way along it [m]."""

DROPPED: Final = 0.16  # Share of the height that a dropped kerb keeps: 2 cm (DIN 32984: at most 3)
DROP_NEAR_M: Final = 0.3
DROP_FAR_M: Final = 1.5
"""A kerb is dropped within the first of a crossing and at full height beyond the second."""

KERBED_NEAR_M: Final = 1.0
KERBED_FAR_M: Final = 3.0
"""Within the first of a sidewalk or of a junction with sidewalks the carriageway has a kerb; beyond the second its edge
lies flush."""


EXACT_M: Final = 1e-7
"""Points nearer to a shape than this lie on it."""


class Relief:
    """The height of the ground in one neighbourhood."""

    def __init__(self, plan: SurfaceLayout, near: shapely.Polygon) -> None:
        reach = near.buffer(2 * KERBED_FAR_M + 1.0, join_style="mitre")
        self.road: BaseGeometry = plan.road_near(reach)
        self._walks = shapely.union_all([*plan.sidewalks.at(reach), *plan.corners.at(reach), *plan.bays.at(reach)])
        self._crossings = shapely.union_all(plan.crossings.at(reach))
        for shape in (self.road, self._walks, self._crossings):
            shapely.prepare(shape)

    def heights(self, xy: Float64Array) -> Float64Array:
        """Height of the ground [m] at points (n, 2), world frame."""
        points = np.asarray(shapely.points(xy), dtype=object)
        section = np.array(PROFILE)
        rise = np.interp(_distance(points, self.road), section[:, 0], section[:, 1])
        return np.asarray(KERB_M * rise * self.kerbed(points) * self._dropped(points))

    def kerbed(self, points: GeometryArray) -> Float64Array:
        """1 where there is a kerb, 0 where the edge lies flush."""
        return _ramp(_distance(points, self._walks), KERBED_FAR_M, KERBED_NEAR_M)

    def _dropped(self, points: GeometryArray) -> Float64Array:
        return DROPPED + (1.0 - DROPPED) * _ramp(_distance(points, self._crossings), DROP_NEAR_M, DROP_FAR_M)


def heights(plan: SurfaceLayout, xy: npt.ArrayLike) -> Float64Array:
    """Height of the ground [m] at points (n, 2), world frame: the base of objects there."""
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    if not len(points):
        return np.zeros(0)
    return Relief(plan, shapely.box(*points.min(axis=0), *points.max(axis=0))).heights(points)


def _distance(points: GeometryArray, shape: BaseGeometry) -> Float64Array:
    """Distance [m], 0 inside, far where there is no shape."""
    away = np.nan_to_num(shapely.distance(points, shape), nan=1e3)
    return np.asarray(np.where(away < EXACT_M, 0.0, away), dtype=np.float64)


def _ramp(value: Float64Array, low: float, high: float) -> Float64Array:
    """0 at `low`, 1 at `high`, straight between."""
    return np.asarray(np.clip((value - low) / (high - low), 0.0, 1.0))
