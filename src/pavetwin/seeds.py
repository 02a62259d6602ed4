"""Named child streams of one random seed, so that drawing more numbers in one part leaves all others unchanged."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """Purposes of random choices. The numbers are part of the file formats: append, never renumber."""

    WORLD = 0
    DEFECTS = 1
    TRAFFIC = 2
    DEMAND = 3
    SENSING = 4
    ORDER = 5
    FURNITURE = 6
    SCENE = 7
    CAPTURE = 8
    FRAME = 9
    EXPERIMENT = 10
    PARKING = 11
    DATASET = 12
    BALANCE = 13
    COMPOSITE = 14
    TRAINING = 15
    FALSE_ALARMS = 17


def child(seed: int, stream: Stream, *keys: int) -> np.random.Generator:
    """The generator of `stream` under `seed`; further `keys` (≥ 0) name its children.

    The same arguments give the same numbers on every machine. Seed 0 is valid.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(stream), *keys)))
