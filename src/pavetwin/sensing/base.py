"""What a captured frame is to a sensor, and where sensors are registered."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from pavetwin.config.mission import SensingSettings
from pavetwin.plugins import find_class
from pavetwin.registry import Registry
from pavetwin.twin import Place


@dataclass(frozen=True, slots=True)
class Sighting:
    """A defect that a frame could show: its centre is in the inspection window and enough of it unoccluded."""

    defect: int
    visible_fraction: float
    attempt: int
    """0 for the first time that this defect is tried."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One capture, as far as an abstract sensor needs it."""

    time_s: float
    position: Place
    altitude_m: float
    yaw_rad: float
    sightings: Sequence[Sighting]


class Sensor(ABC):
    """Decides which of the sighted defects a frame confirms."""

    name: str = ""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        self.settings = settings
        self.seed = seed

    @abstractmethod
    def detect(self, frame: Frame) -> Sequence[int]:
        """The ids of the defects confirmed, a subset of the frame's sightings.

        The random number of a defect's k-th attempt must depend only on (seed, defect, k), so that policies are
        compared with common random numbers.
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
