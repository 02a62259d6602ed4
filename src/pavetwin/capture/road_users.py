"""Where people and vehicles are on a split's streets in recorded traffic: centres of images that show one of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
import shapely

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.capture.presence import SAMPLED_S
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import Segment

BESIDE_M: Final = 2.0
"""People on a sidewalk are taken where the carriageway is this near."""

TRIES: Final = 50
"""Road users that are drawn until one is far enough from every defect."""


@dataclass(frozen=True)
class RoadUser:
    """A person or vehicle at a time of the recording."""

    xy: Float64Array
    """(2,) metres, world frame."""
    time_s: float
    segment: Segment
    """The nearest."""


@dataclass(frozen=True)
class RoadUsers:
    """Samples of a recording on some segments. Arrays are (samples,), people first."""

    segments: Sequence[Segment]
    xy: Float64Array
    """(samples, 2) metres."""
    time_s: Float64Array
    nearest: IndexArray
    """Index into `segments`."""
    people: int
    """How many of the samples are people."""

    @classmethod
    def of(cls, recording: Recording, segments: Sequence[Segment]) -> Self:
        """Everyone on the segments or just beside them, every ten seconds."""
        frames = np.arange(0, recording.frames, max(1, round(SAMPLED_S / recording.step_s)))
        first, last = recording.step_offsets[frames], recording.step_offsets[frames + 1]
        rows = np.concatenate([np.arange(*bounds) for bounds in zip(first, last, strict=True)])
        time_s = np.repeat(frames * recording.step_s, last - first)
        xy = np.column_stack([recording.x[rows], recording.y[rows]]).astype(np.float64)
        tree = shapely.STRtree([segment.polygon for segment in segments])
        inside, nearest = tree.query_nearest(shapely.points(xy), max_distance=BESIDE_M, all_matches=False)
        walks = recording.agents.is_pedestrian[recording.agent[rows[inside]]]
        order = np.argsort(~walks, kind="stable")
        inside, nearest = inside[order], nearest[order]
        return cls(segments, xy[inside], time_s[inside], nearest, int(walks.sum()))

    def draw(self, rng: np.random.Generator, defects: shapely.STRtree, radius_m: float) -> RoadUser | None:
        """One with no defect within a radius: half of them people, half vehicles; None if none was found.

        Args:
            defects: their outlines.
        """
        groups = [(0, self.people), (self.people, len(self.xy))]
        groups = [(first, last) for first, last in groups if last > first]
        for _ in range(TRIES if groups else 0):
            first, last = groups[int(rng.integers(len(groups)))]
            row = int(rng.integers(first, last))
            if not len(defects.query(shapely.Point(self.xy[row]), predicate="dwithin", distance=radius_m)):
                return RoadUser(self.xy[row], float(self.time_s[row]), self.segments[int(self.nearest[row])])
        return None
