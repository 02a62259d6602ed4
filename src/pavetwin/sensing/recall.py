"""The sensor that finds a defect with the detector's recall."""

from collections.abc import Sequence

import numpy as np

from pavetwin.config.mission import SensingSettings
from pavetwin.seeds import Stream, child
from pavetwin.sensing.base import Sensor, sensor
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame, Sighting


@sensor("recall")
class Recall(Sensor):
    """Reports each sighting with probability `recall` (0.840, the YOLOv8n of arXiv 2606.20742); precision 1."""

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        super().__init__(settings, seed)
        self._draws: dict[int, tuple[np.random.Generator, list[float]]] = {}

    def detect(self, frame: Frame) -> Sequence[Detection]:
        return [Detection.of(sighting) for sighting in frame.sightings if self._draw(sighting) < self.settings.recall]

    def _draw(self, sighting: Sighting) -> float:
        """The k-th number of the defect's own generator."""
        defect = sighting.defect.id
        if defect not in self._draws:
            self._draws[defect] = (child(self.seed, Stream.SENSING, defect), [])
        generator, draws = self._draws[defect]
        while len(draws) <= sighting.attempt:
            draws.append(float(generator.random()))
        return draws[sighting.attempt]
