"""Where sensors are registered, and how one is found by its name or its file."""

from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.plugins import find_class
from pavetwin.registry import Registry
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.conformance import check_sensor


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
"""Register a sensor under a name, which `sensing.sensor` then takes."""


def sensor_names() -> list[str]:
    """The registered sensors, in the order of registration."""
    return SENSORS.names()


def load_sensor(settings: SensingSettings, seed: int) -> Sensor:
    """The sensor that the settings name, or a user's own as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: as `sensor_class`, or an option does not fit.
    """
    return sensor_class(settings.sensor)(settings, seed)


def reused_sensor(settings: SensingSettings, seed: int) -> Sensor | None:
    """A sensor for several missions, see `Sensor.is_reused`; None where each mission needs its own.

    Raises:
        PaveTwinError: as `load_sensor`.
    """
    return load_sensor(settings, seed) if sensor_class(settings.sensor).is_reused else None


def unnamed_models(settings: SensingSettings) -> dict[str, OptionValue]:
    """The models of a sensor (`Sensor.model_options`) that the settings do not name: by option, those of now.

    Raises:
        PaveTwinError: as `sensor_class`.
    """
    kind = sensor_class(settings.sensor)
    return {option: kind.default_options[option] for option in kind.model_options if option not in settings.options}


def with_models(settings: SensingSettings) -> SensingSettings:
    """The same settings, with the names of the models that they leave to the sensor.

    Raises:
        PaveTwinError: as `sensor_class`.
    """
    unnamed = unnamed_models(settings)
    return settings.model_copy(update={"options": {**settings.options, **unnamed}}) if unnamed else settings


def sensor_class(name: str) -> type[Sensor]:
    """The class of a sensor, by its name or as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: there is none, its file does not give a sensor, or the sensor breaks a rule.
    """
    kind = find_class(SENSORS, Sensor, name)
    if "name" not in vars(kind):
        kind.name = kind.__name__
    return kind
