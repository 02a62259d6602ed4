"""The sensor that finds a defect with the detector's recall."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pavetwin.seeds import Stream, child
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.registered import sensor


@sensor("recall")
class Recall(Sensor):
    """Reports each sighting with probability `recall` (0.840, the YOLOv8n of arXiv 2606.20742); precision 1."""

    def detect(self, frame: Frame) -> Sequence[Detection]:
        return [Detection.of(sighting) for sighting in frame.sightings if self._draw(sighting) < self.settings.recall]

    def _draw(self, sighting: Sighting) -> float:
        """The k-th number of the defect's own generator."""
        generator, drawn = _noise(self.seed, sighting.defect.id)
        while len(drawn) <= sighting.attempt:
            drawn.append(float(generator.random()))
        return drawn[sighting.attempt]


@lru_cache(maxsize=8192)
def _noise(seed: int, defect: int) -> tuple[np.random.Generator, list[float]]:
    """A defect's generator and what it has drawn so far; policies that are compared share them."""
    return child(seed, Stream.SENSING, defect), []
