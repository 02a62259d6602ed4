"""The registry of sensors, and the rules that every sensor keeps, tried on made-up captures.

Policies are compared under the same random numbers: whether a defect's k-th attempt succeeds may depend on the seed,
the defect, k, and on what the frame shows of it, but not on earlier frames. False alarms break no rule.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Point

from pavetwin.arrays import UInt8Array
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.detections import NO_DETECTIONS, Detections
from pavetwin.plugins import find_class
from pavetwin.registry import Registry
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.resolution import orientations_of, smallest_extent_m
from pavetwin.sensing.sensor import Sensor, unknown_class
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import Defect, Severity

SEEDS = (0, 1, 7)

FRESH = 5
"""Every fifth frame is also shown to a sensor of its own; making one may take long where it loads a detector."""


def check_sensor(factory: Callable[[SensingSettings, int], Sensor]) -> list[str]:
    """The rules that a sensor breaks, a sentence each.

    It must return detections of known classes, and the same for a frame and a seed, in any order of frames.
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
    """Detections of a sensor in each frame, as sets to compare."""
    found: list[frozenset[Hashable]] = []
    for frame in frames:
        before = repr(frame)
        answer = sensor.detect(frame)
        if not isinstance(answer, Detections):
            broken.append(f"it returns {answer!r}, which is not Detections")
            answer = NO_DETECTIONS
        known, classes = DEFECT_CLASSES.names(), sorted(set(answer.class_name))
        messages = [unknown_class(name, known, sensor.other_classes) for name in classes]
        broken += [f"it reports {message}" for message in messages if message]
        if repr(frame) != before:
            broken.append("it changes the frame it was given")
        rows = zip(answer.class_name, answer.confidence, shapely.to_wkb(answer.footprint), answer.box_px, strict=True)
        found.append(frozenset((name, sure, place, box.tobytes()) for name, sure, place, box in rows))
    return found


def _named(name: str, kind: type[Sensor]) -> None:
    kind.name = name


SENSORS: Registry[type[Sensor]] = Registry(
    "sensor",
    key="sensing.sensor",
    group="pavetwin.sensors",
    home="pavetwin.sensing",
    on_add=_named,
    rules=check_sensor,
)
sensor = SENSORS.register
"""Register a sensor under a name for `sensing.sensor`."""


def sensor_names() -> list[str]:
    """The registered sensors, in the order of registration."""
    return SENSORS.names()


def load_sensor(settings: SensingSettings, seed: int) -> Sensor:
    """The sensor named in the settings, or a user's own as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: as in `sensor_class`, or an option does not fit.
    """
    return sensor_class(settings.sensor)(settings, seed)


def reused_sensor(settings: SensingSettings, seed: int) -> Sensor | None:
    """A sensor for several missions, see `Sensor.is_reused`; None where each mission needs its own.

    Raises:
        PaveTwinError: as in `load_sensor`.
    """
    return load_sensor(settings, seed) if sensor_class(settings.sensor).is_reused else None


def unnamed_models(settings: SensingSettings) -> dict[str, OptionValue]:
    """Default models of a sensor (`Sensor.model_options`) that the settings do not name, by option.

    Raises:
        PaveTwinError: as in `sensor_class`.
    """
    kind = sensor_class(settings.sensor)
    return {option: kind.default_options[option] for option in kind.model_options if option not in settings.options}


def with_models(settings: SensingSettings) -> SensingSettings:
    """The same settings with the default models of the sensor named.

    Raises:
        PaveTwinError: as in `sensor_class`.
    """
    unnamed = unnamed_models(settings)
    return settings.model_copy(update={"options": {**settings.options, **unnamed}}) if unnamed else settings


def sensor_class(name: str) -> type[Sensor]:
    """The class of a sensor, by its name or as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: there is no such sensor, its file defines none, or the sensor breaks a rule.
    """
    kind = find_class(SENSORS, Sensor, name)
    if "name" not in vars(kind):
        kind.name = kind.__name__
    return kind
