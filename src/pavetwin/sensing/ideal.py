"""The sensor that misses nothing."""

from collections.abc import Sequence

from pavetwin.sensing.base import Frame, Sensor, sensor


@sensor("ideal")
class Ideal(Sensor):
    """Recall 1: every sighted defect is confirmed."""

    def detect(self, frame: Frame) -> Sequence[int]:
        return [sighting.defect for sighting in frame.sightings]
