"""The rules of sensors, tried on made-up captures.

Policies are compared under the same random numbers: whether a defect's k-th attempt succeeds may depend on the seed,
the defect and k, and on what the frame shows of it, but not on which frames came before. A sensor may report what is
not there: false alarms break no rule.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Point

from pavetwin.arrays import UInt8Array
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import SensingSettings
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection, unknown_class
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.resolution import orientations_of, smallest_extent_m
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import Defect, Severity

SEEDS = (0, 1, 7)

FRESH = 5
"""Every such frame is also shown to a sensor of its own: making one may take long, where it loads a detector."""


def check_sensor(factory: Callable[[SensingSettings, int], Sensor]) -> list[str]:
    """The rules that a sensor breaks, each as a sentence; none for one that keeps them.

    It must answer with detections of known classes, and the same whenever it is shown a frame with the same seed, in
    whatever order.
    """
    broken: list[str] = []
    frames = trial_frames()
    for recall, seeds in ((0.5, SEEDS), (0.0, SEEDS[:1]), (1.0, SEEDS[:1])):
        settings = SensingSettings(recall=recall)
        for seed in seeds:
            try:
                first = [_reported(factory(settings, seed), [frame], broken)[0] for frame in frames[::FRESH]]
                forwards = _reported(factory(settings, seed), frames, broken)
                backwards = _reported(factory(settings, seed), frames[::-1], broken)[::-1]
                turned = _reported(factory(settings, seed), [_turned(frame) for frame in frames], broken)
            except Exception as error:
                return [*broken, f"with seed {seed}, it fails: {type(error).__name__}: {' '.join(str(error).split())}"]
            if not (forwards == backwards == turned and first == forwards[::FRESH]):
                broken.append(f"with seed {seed}, what it reports depends on what it was shown before, or on the order")
    return list(dict.fromkeys(broken))


def trial_frames(count: int = 24) -> list[Frame]:
    """Captures of none, one and many defects, with a first attempt and later ones."""
    camera = find_camera("paper")
    frames = []
    for number in range(count):
        defects = np.random.default_rng(number).permutation(40)[: (0, 1, 3, 12)[number % 4]]
        sightings = tuple(
            trial_sighting(trial_defect(int(d), 3.0 * number), 0.35 + 0.65 * (int(d) % 5) / 4, number // 4)
            for d in defects
        )
        place = (3.0 * number, 0.0)
        frames.append(
            Frame(
                number=number,
                time_s=0.6 * number,
                position=place,
                altitude_m=10.0,
                yaw_rad=0.1 * number,
                camera=camera,
                conditions=Conditions(),
                velocity_mps=(5.0, 0.0),
                sightings=sightings,
                source=_grey,
            )
        )
    return frames


def trial_sighting(defect: Defect, visible_fraction: float = 1.0, attempt: int = 0) -> Sighting:
    return Sighting(defect, visible_fraction, attempt, smallest_extent_m(defect), orientations_of(defect))


def trial_defect(number: int, east_m: float = 0.0) -> Defect:
    """One of 40 small defects around a place, every registered class in turn."""
    classes = DEFECT_CLASSES.names()
    centre = Point(east_m + 0.5 * (number % 8) - 2.0, 0.6 * (number // 8) - 1.5)
    return Defect(
        id=number,
        segment="s0001",
        kind=classes[number % len(classes)],
        centre=centre,
        polygon=centre.buffer(0.2, quad_segs=2),
        seed=number,
        yaw_rad=0.0,
        severity=Severity.MEDIUM,
        width_m=0.02,
        depth_m=0.02,
        length_m=0.4,
        volume_m3=0.001,
    )


def _grey(frame: Frame) -> UInt8Array:
    width, height = frame.camera.image_px
    return np.full((height, width, 3), 128, dtype=np.uint8)


def _turned(frame: Frame) -> Frame:
    return replace(frame, sightings=tuple(frame.sightings)[::-1])


def _reported(sensor: Sensor, frames: Sequence[Frame], broken: list[str]) -> list[frozenset[Hashable]]:
    """What a sensor answers to each frame, in a form that can be compared."""
    found = []
    for frame in frames:
        before = repr(frame)
        answer = list(sensor.detect(frame))
        strangers = [each for each in answer if not isinstance(each, Detection)]
        if strangers:
            broken.append(f"it answers {strangers[0]!r}, which is not a Detection")
            answer = []
        known = DEFECT_CLASSES.names()
        told = [unknown_class(kind, known, sensor.other_classes) for kind in sorted({each.kind for each in answer})]
        broken += [f"it reports {unknown}" for unknown in told if unknown]
        if repr(frame) != before:
            broken.append("it changes the frame it was given")
        found.append(frozenset(_value(each) for each in answer))
    return found


def _value(detection: Detection) -> Hashable:
    place = None if detection.footprint is None else shapely.to_wkb(detection.footprint)
    return detection.kind, detection.confidence, place, detection.box_px
