"""Which streets the recorded traffic is on: pictures of an empty one hold no vehicle to learn from or be tested on."""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import World

SAMPLED_S: Final = 10.0
"""Agents are counted this often."""

BESIDE_M: Final = 5.0
"""People on the sidewalks of a carriageway, and agents this near to it on a junction, are on its street."""


def presence(world: World, recordings: Iterable[Recording]) -> Mapping[str, Float64Array]:
    """Street → (2,) vehicles and people that are on it at a time, on average, of all recordings together."""
    names, street = np.unique([segment.street for segment in world.segments], return_inverse=True)
    tree = shapely.STRtree([segment.polygon for segment in world.segments])
    counts = np.zeros((len(names), 2))
    for recording in recordings:
        frames = range(0, recording.frames, max(1, round(SAMPLED_S / recording.step_s)))
        offsets = recording.step_offsets
        rows = np.concatenate([np.arange(offsets[frame], offsets[frame + 1]) for frame in frames])
        places = shapely.points(recording.x[rows].astype(np.float64), recording.y[rows].astype(np.float64))
        which, nearest = tree.query_nearest(places, max_distance=BESIDE_M, all_matches=False)
        walks = recording.agents.is_pedestrian[recording.agent[rows[which]]].astype(np.intp)
        np.add.at(counts, (street[nearest], walks), 1 / len(frames))
    return dict(zip(names.tolist(), counts, strict=True))
