"""What a captured frame is to a sensor, and where sensors are registered."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pavetwin.config.mission import SensingSettings
from pavetwin.errors import PaveTwinError, nearest_name
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

        The luck of a defect's k-th attempt must depend on (seed, defect, k) alone, so that policies are compared
        under the same luck.
        """


_SENSORS: dict[str, type[Sensor]] = {}


def sensor(name: str) -> Callable[[type[Sensor]], type[Sensor]]:
    """Register a sensor under `name`, which `sensing.sensor` then takes."""

    def register(kind: type[Sensor]) -> type[Sensor]:
        if name in _SENSORS:
            raise ValueError(f"a sensor '{name}' is registered already")
        kind.name = name
        _SENSORS[name] = kind
        return kind

    return register


def sensor_names() -> list[str]:
    return list(_SENSORS)


def load_sensor(settings: SensingSettings, seed: int) -> Sensor:
    """The sensor that the settings name.

    Raises:
        PaveTwinError: there is none; the message names the nearest.
    """
    if settings.sensor not in _SENSORS:
        near = nearest_name(settings.sensor, _SENSORS) or f"; known are {', '.join(_SENSORS)}"
        raise PaveTwinError(f"sensing.sensor: no sensor '{settings.sensor}'{near}.")
    return _SENSORS[settings.sensor](settings, seed)
