"""The base class of sensors, their registry, and the rules that every sensor keeps.

Policies are compared under the same random numbers: whether a defect's k-th attempt succeeds may depend on the seed,
the defect, k, and on what the frame shows of it, but not on earlier frames. False alarms break no rule.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import ClassVar, Final

import numpy as np
import shapely
from shapely import Point

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue, checked_options
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.detections import NO_DETECTIONS, Detections
from pavetwin.errors import nearest_name
from pavetwin.labels.class_names import TRAFFIC
from pavetwin.plugins import find_class
from pavetwin.registry import Registry
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.resolution import orientations_of, smallest_extent_m
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import Defect, Severity

PARAMETER_DRAWS: Final = 20
"""Number of draws of a fitted sensor's parameters, the same in all missions with it."""


class Sensor(ABC):
    """Reports detections in a frame. It may miss defects, and report false alarms."""

    name: str = ""
    every_capture: ClassVar[bool] = False
    """Whether it is shown every capture, instead of only those that see a defect which is not confirmed yet."""

    sees_confirmed: ClassVar[bool] = False
    """Whether sightings include defects that are confirmed already, as for a sensor that searches images."""

    judges_size: ClassVar[bool] = False
    """Whether it misses defects that cover too few pixels, by `sensing.least_px`."""

    other_classes: ClassVar[frozenset[str]] = frozenset()
    """Classes that it reports besides defects, `person` and `car`: such detections are ignored. Any other class that is
    not registered is an error."""
    is_fitted: ClassVar[bool] = False
    """Whether its parameters are fitted, so that it implements `found_by_draws`."""
    is_reused: ClassVar[bool] = False
    """Whether one instance may serve several missions over the same world, defects, traffic and parked vehicles, under
    the same settings and seed: it then searches the captures that they share only once."""
    after_landing: bool = False
    """Whether it searches all captures after the mission, in `look_at`: policies then know no detections."""
    measures_sizes: bool = False
    """Whether its detections have sizes and `pixel_mm`, and it reports all that it sees: the condition index of a road
    then follows from its detections. An instance may override its class."""
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType({})
    """Options with their defaults. A value in `sensing.options` must have the type of its default; a whole number is a
    number too."""
    model_options: ClassVar[tuple[str, ...]] = ()
    """Options whose default names a shipped model, which another version may replace: missions and studies store the
    one in use."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        """Raises:
        PaveTwinError: there is no such option, or a value is of another type.
        """
        self.settings = settings
        self.seed = seed
        self.options: Mapping[str, OptionValue] = checked_options(
            settings.options,
            self.default_options,
            key="sensing.options",
            owner=f"the sensor '{self.name or type(self).__name__}'",
        )
        """The value of every option."""

    def look_at(
        self,
        frames: Sequence[Frame],  # noqa: ARG002 - for those that look after landing
        on_progress: Callable[[float], None] = lambda _: None,
    ) -> None:
        """Prepare the detections of a mission's captures together; `detect` is called for each of them afterwards.

        Args:
            frames: all captures of the mission, in the order of time, without sightings.
            on_progress: called with the share done, 0 … 1.
        """
        on_progress(1.0)

    @property
    def looked_px(self) -> int | None:
        """Longer side of the images that it searches, unless the camera's is shorter; None for a sensor without images.

        For a sensor with images, each capture is an attempt at every defect in it, and missions store which it found.
        """
        return None

    def found_by_draws(self, defects: Sequence[int]) -> Float64Array | None:  # noqa: ARG002 - for fitted sensors
        """Probability that the looks so far find each defect, in draws of the sensor's uncertain parameters.

        Args:
            defects: ids.

        Returns:
            (`PARAMETER_DRAWS`, defects); None for a sensor whose parameters are stated, not fitted.
        """
        return None

    @abstractmethod
    def detect(self, frame: Frame) -> Detections:
        """Detections in a frame.

        Each has a class, a confidence, and at least one of a `footprint` in the world frame and a `box_px` in the
        frame's image. Policies are compared under the same random numbers: the draw for a defect's k-th attempt must
        depend on (seed, defect, k) alone, and the draw for a false alarm on the seed and the frame alone.
        """


def unknown_class(class_name: str, defects: Collection[str], others: Collection[str]) -> str:
    """Message on a detection's class; empty for a known one.

    Args:
        defects: the classes of defects.
        others: other classes of the sensor, see `Sensor.other_classes`.
    """
    if class_name in defects or class_name in TRAFFIC or class_name in others:
        return ""
    near = nearest_name(class_name.lower().replace(" ", "_"), defects)
    return (
        f"the class '{class_name}', which is not a class of defects{near}; known are {', '.join(sorted(defects))}. A "
        "class that is not a defect belongs in its `other_classes`"
    )


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
