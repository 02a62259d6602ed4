"""Where parked vehicles stand, as outlines on the ground: what they cover, and which poses they leave no room for."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import shapely

from pavetwin.arrays import GeometryArray, IndexArray
from pavetwin.capture.defect_index import DefectIndex
from pavetwin.capture.platforms import Pose
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.solids import Solids, parked_boxes

if TYPE_CHECKING:
    from pavetwin._core import Trace

REACH_M = 20.0
"""Only what stands this near to a vehicle may overlap it."""


@dataclass(frozen=True)
class ParkedBodies:
    """Parked vehicles and their outlines."""

    vehicles: ParkedVehicles
    outlines: shapely.STRtree

    @classmethod
    def of(cls, parked: ParkedVehicles) -> Self:
        """Of all parked vehicles of an image's world."""
        xy = np.column_stack([parked.x, parked.y])
        boxes = parked_boxes(xy, parked.yaw_rad, parked.length_m, parked.width_m, parked.height_m)
        return cls(parked, shapely.STRtree(_outlines(boxes)))

    def covered(self, defects: DefectIndex) -> IndexArray:
        """The defects whose centre lies below a parked vehicle."""
        if not len(self.vehicles):
            return np.zeros(0, dtype=np.intp)
        under, _ = self.outlines.query(shapely.points(defects.centres[:, :2]), predicate="intersects")
        return np.unique(under)

    def overlap(self, pose: Pose, trace: "Trace") -> bool:
        """Whether the vehicle that carries the camera would stand in one of them."""
        if pose.ego is None or not len(self.vehicles):
            return False
        x, y, _ = pose.view.position.tolist()
        poses = trace.agents_near(x, y, REACH_M, pose.time_s)
        own = poses["agent"] == pose.ego
        xy = np.column_stack([poses["x_m"][own], poses["y_m"][own]])
        size = (poses[name][own] for name in ("length_m", "width_m", "height_m"))
        body = _outlines(parked_boxes(xy, poses["yaw_rad"][own], *size))
        return bool(self.outlines.query(body, predicate="intersects").size)


def _outlines(boxes: Solids) -> GeometryArray:
    return np.asarray(shapely.polygons(boxes.xy.reshape(-1, 4, 2)), dtype=object)
