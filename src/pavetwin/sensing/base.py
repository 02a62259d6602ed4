"""What a sensor is, and where sensors are registered."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from pavetwin.config.mission import SensingSettings
from pavetwin.plugins import find_class
from pavetwin.registry import Registry
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame


class Sensor(ABC):
    """Reports what it finds in a frame. It may miss what is there and report what is not."""

    name: str = ""
    every_capture: ClassVar[bool] = False
    """Whether it is shown every capture; else only those that see a defect which is not confirmed yet."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        self.settings = settings
        self.seed = seed

    @abstractmethod
    def detect(self, frame: Frame) -> Sequence[Detection]:
        """What it finds in a frame.

        Policies are compared under the same random numbers: what a sensor draws for a defect's k-th attempt must
        depend on (seed, defect, k) alone, and what it draws for a false alarm on the seed and the frame alone.
        """


def _named(name: str, kind: type[Sensor]) -> None:
    kind.name = name


def _broken_rules(kind: type[Sensor]) -> list[str]:
    from pavetwin.sensing.conformance import check_sensor  # which knows what a sensor is from here

    return check_sensor(kind)


SENSORS: Registry[type[Sensor]] = Registry(
    "sensor",
    key="sensing.sensor",
    group="pavetwin.sensors",
    home="pavetwin.sensing",
    on_add=_named,
    rules=_broken_rules,
)
sensor = SENSORS.register
"""Register a sensor under a name, which `sensing.sensor` then takes."""


def sensor_names() -> list[str]:
    """The registered sensors, in the order of registration."""
    return SENSORS.names()


def load_sensor(settings: SensingSettings, seed: int) -> Sensor:
    """The sensor that the settings name, or a user's own as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: there is none, its file does not give a sensor, or the sensor breaks a rule.
    """
    kind = find_class(SENSORS, Sensor, settings.sensor)
    if "name" not in vars(kind):
        kind.name = kind.__name__
    return kind(settings, seed)
