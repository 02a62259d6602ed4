"""The rules of sensors, tried on made-up captures.

Policies are compared with common random numbers: whether a defect's k-th attempt succeeds may depend on the seed, the
defect and k, and on what the frame shows of it, but not on which frames came before.
"""

from collections.abc import Callable, Sequence

import numpy as np

from pavetwin.config.mission import SensingSettings
from pavetwin.sensing.base import Frame, Sensor, Sighting

SEEDS = (0, 1, 7)


def check_sensor(factory: Callable[[SensingSettings, int], Sensor]) -> list[str]:
    """The rules that a sensor breaks, each as a sentence; none for a sound one.

    It must confirm only what a frame shows, each defect once, and the same whenever it is tried with the same seed, in
    whatever order.
    """
    broken: list[str] = []
    for recall in (0.0, 0.5, 1.0):
        settings = SensingSettings(recall=recall)
        for seed in SEEDS:
            frames = trial_frames()
            try:
                first = [_confirmed(factory(settings, seed), [frame], broken)[0] for frame in frames]
                forwards = _confirmed(factory(settings, seed), frames, broken)
                backwards = _confirmed(factory(settings, seed), frames[::-1], broken)[::-1]
                turned = _confirmed(factory(settings, seed), [_turned(frame) for frame in frames], broken)
            except Exception as error:
                return [*broken, f"with seed {seed}, it fails: {type(error).__name__}: {' '.join(str(error).split())}"]
            if not first == forwards == backwards == turned:
                broken.append(
                    f"with seed {seed}, what it confirms depends on what it was shown before, or on the order"
                )
    return list(dict.fromkeys(broken))


def trial_frames(count: int = 24) -> list[Frame]:
    """Captures of none, one and many defects, with a first attempt and later ones."""
    frames = []
    for number in range(count):
        defects = np.random.default_rng(number).permutation(40)[: (0, 1, 3, 12)[number % 4]]
        sightings = tuple(Sighting(int(d), 0.35 + 0.65 * (int(d) % 5) / 4, number // 4) for d in defects)
        frames.append(Frame(0.6 * number, (3.0 * number, 0.0), 10.0, 0.1 * number, sightings))
    return frames


def _turned(frame: Frame) -> Frame:
    return Frame(frame.time_s, frame.position, frame.altitude_m, frame.yaw_rad, tuple(frame.sightings)[::-1])


def _confirmed(sensor: Sensor, frames: Sequence[Frame], broken: list[str]) -> list[frozenset[int]]:
    found = []
    for frame in frames:
        before = repr(frame)
        answer = list(sensor.detect(frame))
        shown = {sighting.defect for sighting in frame.sightings}
        if not set(answer) <= shown:
            broken.append(f"it confirms {sorted(set(answer) - shown)}, which the frame does not show")
        if len(set(answer)) != len(answer):
            broken.append("it confirms a defect twice in one frame")
        if repr(frame) != before:
            broken.append("it changes the frame it was given")
        found.append(frozenset(answer))
    return found
