"""Sensors with a stated recall, `ideal` and `recall`, and the random numbers of looks at a defect."""

from functools import lru_cache
from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from pavetwin.config.mission import SensingSettings
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.detections import Detections
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.seeds import Stream, child
from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.sensing.resolution import sighted_share
from pavetwin.sensing.sensor import Sensor, sensor

_NORMAL: Final = NormalDist()
_COMMON: Final = 0
"""Key of the random stream that all looks at a defect share."""
_SMALLEST: Final = 2.0**-54
"""Stands for a drawn 0, which has no normal quantile."""


def look_draw(seed: int, defect: int, look: int, correlation: float) -> float:
    """Uniform in 0 … 1: a look finds its defect where this is below its chance.

    With u drawn once for the defect and e for each look, both standard normal, and the correlation ρ, it is Φ(z) of
    z = √ρ · u + √(1 − ρ) · e (a Gaussian copula): each is uniform, and any two z of a defect have the correlation ρ. It
    depends on the arguments alone.

    Args:
        defect: id of the defect.
        look: 0 for the first attempt at it.
    """
    if not correlation:
        return _drawn(seed, defect, look)
    return _NORMAL.cdf(look_quantile(seed, defect, look, correlation))


def look_quantile(seed: int, defect: int, look: int, correlation: float) -> float:
    """The z of `look_draw`, standard normal: a look finds its defect where this is below its score, Φ⁻¹ of its
    chance."""
    known = _quantiles(seed, defect, correlation)
    while len(known) <= look:
        own = _NORMAL.inv_cdf(max(_drawn(seed, defect, len(known)), _SMALLEST))
        known.append(sqrt(correlation) * _common(seed, defect) + sqrt(1 - correlation) * own)
    return known[look]


def _drawn(seed: int, defect: int, look: int) -> float:
    generator, drawn = _noise(seed, defect)
    while len(drawn) <= look:
        drawn.append(float(generator.random()))
    return drawn[look]


@lru_cache(maxsize=8192)
def _quantiles(seed: int, defect: int, correlation: float) -> list[float]:  # noqa: ARG001 - the cache's key
    """Quantiles of a defect that are computed so far."""
    return []


@lru_cache(maxsize=8192)
def _noise(seed: int, defect: int) -> tuple[np.random.Generator, list[float]]:
    """Generator of a defect and its numbers so far; compared policies share them."""
    return child(seed, Stream.SENSING, defect), []


@lru_cache(maxsize=8192)
def _common(seed: int, defect: int) -> float:
    """Difficulty of a defect in all looks at it, standard normal."""
    return float(child(seed, Stream.SENSING, defect, _COMMON).standard_normal())


@sensor("ideal")
class Ideal(Sensor):
    """Reports every sighted defect with its outline: recall 1, precision 1."""

    def detect(self, frame: Frame) -> Detections:
        return Detections.of_defects(sighting.defect for sighting in frame.sightings)


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

    def detect(self, frame: Frame) -> Detections:
        return Detections.of_defects(
            sighting.defect
            for sighting in frame.sightings
            if look_draw(self.seed, sighting.defect.id, sighting.attempt, self.settings.look_correlation)
            < self.chance(frame, sighting)
        )

    def chance(self, frame: Frame, sighting: Sighting) -> float:
        """Probability that a look finds a defect that it sees."""
        return self.settings.recall * sighted_share(self.settings, frame, sighting)
