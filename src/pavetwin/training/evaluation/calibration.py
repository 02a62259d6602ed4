"""Whether confidences say how often a detection is right (Guo et al. 2017, on detections as Küppers et al. 2020)."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.training.evaluation.matching import HALF, Matched

BINS: Final = 10


@dataclass(frozen=True, slots=True)
class ReliabilityBin:
    """Detections whose confidence lies in a range."""

    low: float
    high: float
    detections: int
    confidence: float | None
    """Their mean; None without any."""
    precision: float | None
    """The share that is right at IoU 0.5."""


@dataclass(frozen=True, slots=True)
class Reliability:
    """Of the detections from a confidence on."""

    least: float
    bins: tuple[ReliabilityBin, ...]

    @property
    def detections(self) -> int:
        return sum(each.detections for each in self.bins)

    @property
    def error(self) -> float | None:
        """Expected calibration error: the mean difference of confidence and precision over detections, bin by bin."""
        if not self.detections:
            return None
        gaps = (
            each.detections * abs(each.confidence - each.precision)
            for each in self.bins
            if each.confidence is not None and each.precision is not None
        )
        return sum(gaps) / self.detections


def reliability(matched: Matched, least: float) -> Reliability:
    """Final confidences in ten equal ranges; detections on ignored regions are not counted.

    Args:
        least: detections below it are not counted.
    """
    kept = [(each.confidence >= least) & ~each.left_out[HALF] for each in matched.classes]
    told = np.concatenate([each.confidence[used] for each, used in zip(matched.classes, kept, strict=True)])
    hits = np.concatenate([each.hit[HALF][used] for each, used in zip(matched.classes, kept, strict=True)])
    place = np.minimum((told * BINS).astype(np.intp), BINS - 1)
    bins = []
    for at in range(BINS):
        mine = place == at
        count = int(mine.sum())
        bins.append(
            ReliabilityBin(
                at / BINS,
                (at + 1) / BINS,
                count,
                float(told[mine].mean()) if count else None,
                float(hits[mine].mean()) if count else None,
            )
        )
    return Reliability(least, tuple(bins))
