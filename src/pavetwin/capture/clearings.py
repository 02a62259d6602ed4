"""Where pictures without a defect can be taken from: the parts of the road that lie far from every defect."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Segment


@dataclass(frozen=True)
class Clearings:
    """The carriageway of some segments without what is near a defect, as triangles to sample points from."""

    corners: Float64Array
    """(n, 3, 2) metres, world frame."""
    owners: tuple[Segment, ...]
    """(n,) the segment of each."""

    @classmethod
    def of(cls, segments: Sequence[Segment], defects: shapely.STRtree, radius_m: float) -> Self:
        """The points from which a disc of that radius holds no defect: centres of images without defects."""
        parts, owners = [], []
        for segment in segments:
            near = defects.geometries[defects.query(segment.polygon, predicate="dwithin", distance=radius_m)]
            # Convex hulls are hardly larger than the outlines, and fifty times as fast to buffer.
            around = shapely.buffer(shapely.convex_hull(near), radius_m, quad_segs=4)
            clear = shapely.difference(segment.polygon, shapely.union_all(around))
            triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(clear))
            parts.append(shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3])
            owners += [segment] * len(triangles)
        return cls(np.concatenate([np.empty((0, 3, 2)), *parts]), tuple(owners))

    def draw(self, rng: np.random.Generator) -> tuple[Float64Array, Segment] | None:
        """A point (2,) drawn uniformly over the area, and its segment; None if there is no such area."""
        sides = self.corners[:, 1:] - self.corners[:, :1]
        areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        if not areas.sum() > 0:
            return None
        index = int(rng.choice(len(areas), p=areas / areas.sum()))
        shares = rng.random(2)
        # The half of the parallelogram beyond the triangle is folded back onto it (Turk 1990).
        shares = shares if shares.sum() <= 1 else 1 - shares
        return self.corners[index, 0] + shares @ sides[index], self.owners[index]
