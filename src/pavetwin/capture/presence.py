"""Which streets the recorded traffic is on: images of an empty street hold no vehicle to train or test on."""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import World

SAMPLED_S: Final = 10.0
"""Interval at which agents are counted."""

BESIDE_M: Final = 5.0
"""People on sidewalks, and agents on a junction, count as on the street whose carriageway is this near."""


def presence(world: World, recordings: Iterable[Recording]) -> Mapping[str, Float64Array]:
    """Street → (2,) mean number of vehicles and people on it at a time, over all recordings."""
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
