"""Which defects a captured frame confirms. One file a sensor, one registry."""

from pavetwin.sensing.base import SENSORS, Frame, Sensor, Sighting, load_sensor, sensor, sensor_names
from pavetwin.sensing.conformance import check_sensor
from pavetwin.sensing.ideal import Ideal
from pavetwin.sensing.recall import Recall

__all__ = [
    "SENSORS",
    "Frame",
    "Ideal",
    "Recall",
    "Sensor",
    "Sighting",
    "check_sensor",
    "load_sensor",
    "sensor",
    "sensor_names",
]
