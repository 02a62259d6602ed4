"""Sensors: what they find in a captured frame. One file a sensor, one registry."""

from pavetwin.detections import Detections, Outcome
from pavetwin.sensing.frame import Box, Frame, ImageSource, Sighting
from pavetwin.sensing.matching import match
from pavetwin.sensing.recall import Ideal, Recall
from pavetwin.sensing.resolution import orientations_of, sighted_share, smallest_extent_m
from pavetwin.sensing.sensor import (
    SENSORS,
    Sensor,
    check_sensor,
    load_sensor,
    reused_sensor,
    sensor,
    sensor_class,
    sensor_names,
    unknown_class,
)

__all__ = [
    "SENSORS",
    "Box",
    "Detections",
    "Frame",
    "Ideal",
    "ImageSource",
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
