"""The sensor that finds a defect with the detector's recall, less where it covers few pixels."""

from collections.abc import Sequence
from functools import lru_cache
from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from pavetwin.config.mission import SensingSettings
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.seeds import Stream, child
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.registered import sensor
from pavetwin.sensing.resolution import sighted_share

_NORMAL: Final = NormalDist()
_COMMON: Final = 0
"""Names the child of a defect's stream that all looks at it share."""
_SMALLEST: Final = 2.0**-54
"""In place of a drawn 0, which has no normal quantile."""


@sensor("recall")
class Recall(Sensor):
    """Reports a sighting with a probability p, at most `recall` (0.840, the YOLOv8n of arXiv 2606.20742).

    p falls with the pixels that the defect covers (`pavetwin.sensing.resolution`). Looks at one defect are not
    independent: with u drawn once for the defect and e for each look, both standard normal, and ρ `look_correlation`,
    z = √ρ · u + √(1 − ρ) · e, and the look finds it where Φ(z) < p. So every single look finds it with exactly the
    probability p, and any two z of a defect have the correlation ρ (a Gaussian copula).
    """

    judges_size = True

    def __init__(self, settings: SensingSettings, seed: int) -> None:
        """Raises:
        PaveTwinError: `sensing.least_px` names a class that is not known.
        """
        super().__init__(settings, seed)
        known = DEFECT_CLASSES.names()
        for kind in settings.least_px or {}:
            if kind not in known:
                raise PaveTwinError(
                    f"sensing.least_px: no defect class '{kind}'{nearest_name(kind, known)}; known are "
                    f"{', '.join(known)}."
                )

    def detect(self, frame: Frame) -> Sequence[Detection]:
        return [
            Detection.of(sighting)
            for sighting in frame.sightings
            if self._draw(sighting) < self.chance(frame, sighting)
        ]

    def chance(self, frame: Frame, sighting: Sighting) -> float:
        """The probability that a look finds what it sees."""
        return self.settings.recall * sighted_share(self.settings, frame, sighting)

    def _draw(self, sighting: Sighting) -> float:
        """Uniform in 0 … 1, by (seed, defect, attempt) alone: of the defect's own generator the k-th number, with
        what all looks at the defect have in common.
        """
        own, correlation = self._own_draw(sighting), self.settings.look_correlation
        if not correlation:
            return own
        look = _NORMAL.inv_cdf(max(own, _SMALLEST))
        return _NORMAL.cdf(sqrt(correlation) * _common(self.seed, sighting.defect.id) + sqrt(1 - correlation) * look)

    def _own_draw(self, sighting: Sighting) -> float:
        generator, drawn = _noise(self.seed, sighting.defect.id)
        while len(drawn) <= sighting.attempt:
            drawn.append(float(generator.random()))
        return drawn[sighting.attempt]


@lru_cache(maxsize=8192)
def _noise(seed: int, defect: int) -> tuple[np.random.Generator, list[float]]:
    """A defect's generator and what it has drawn so far; policies that are compared share them."""
    return child(seed, Stream.SENSING, defect), []


@lru_cache(maxsize=8192)
def _common(seed: int, defect: int) -> float:
    """Standard normal: how hard a defect is to find, for all looks."""
    return float(child(seed, Stream.SENSING, defect, _COMMON).standard_normal())
