"""What a sensor finds in a captured frame. One file a sensor, one registry."""

from pavetwin.sensing.base import Sensor
from pavetwin.sensing.conformance import check_sensor
from pavetwin.sensing.detection import OTHER_CLASSES, Detection, JudgedDetection, MeasuredSizes, Outcome, unknown_class
from pavetwin.sensing.frame import Box, Frame, ImageSource, Sighting
from pavetwin.sensing.ideal import Ideal
from pavetwin.sensing.matching import match
from pavetwin.sensing.recall import Recall
from pavetwin.sensing.registered import SENSORS, load_sensor, reused_sensor, sensor, sensor_class, sensor_names
from pavetwin.sensing.resolution import orientations_of, sighted_share, smallest_extent_m

__all__ = [
    "OTHER_CLASSES",
    "SENSORS",
    "Box",
    "Detection",
    "Frame",
    "Ideal",
    "ImageSource",
    "JudgedDetection",
    "MeasuredSizes",
    "Outcome",
    "Recall",
    "Sensor",
    "Sighting",
    "check_sensor",
    "load_sensor",
    "match",
    "orientations_of",
    "reused_sensor",
    "sensor",
    "sensor_class",
    "sensor_names",
    "sighted_share",
    "smallest_extent_m",
    "unknown_class",
]
