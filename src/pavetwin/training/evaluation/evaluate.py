"""The whole evaluation of one file of detections on one split."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Int64Array
from pavetwin.errors import PaveTwinError
from pavetwin.training.evaluation.breakdowns import (
    Breakdown,
    SeverityAgreement,
    SizeError,
    breakdowns,
    severity_agreements,
    size_errors,
)
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledSplit
from pavetwin.training.evaluation.matching import Matched, check_installed, labelled_only, match_coarse, match_five
from pavetwin.training.evaluation.resampling import (
    Metrics,
    ResampledDifference,
    ResampledInterval,
    differences,
    intervals,
    metrics_of,
)
from pavetwin.training.evaluation.scores import (
    Reliability,
    ScoresAt,
    SubtypeScores,
    best_confidence,
    confusion_matrix,
    reliability,
    scores_at,
    subtypes_of_matched,
    subtypes_of_true,
)

CONFIDENCE: Final = 0.25  # Default confidence for precision, recall and F1

RESAMPLES: Final = 1000


@dataclass(frozen=True)
class DetectorEvaluation:
    """Results of the evaluation of a detector."""

    split: LabelledSplit
    five: Matched
    coarse: Matched
    total: int
    """Detections of this split in the file."""
    at_stated: ScoresAt
    at_best: ScoresAt | None
    """At the confidence that is best on the validation split; None without detections of that split."""
    subtypes_matched: SubtypeScores
    subtypes_true: SubtypeScores | None
    """None without reported subtypes of true regions."""
    confusion: Int64Array
    """See `confusion_matrix`."""
    breakdowns: tuple[Breakdown, ...]
    reliability: Reliability
    """Calibration of all detections."""
    reliability_in_use: Reliability
    """Calibration of the detections from the stated confidence on."""
    intervals: dict[str, ResampledInterval]
    sizes: tuple[SizeError, ...]
    severities: tuple[SeverityAgreement, ...]

    @property
    def unlabelled(self) -> int:
        """Detections left out since their class is not labelled in the image's source."""
        return self.total - len(self.five.found)


def evaluate(
    split: LabelledSplit,
    found: Sequence[FoundBox],
    *,
    validation: LabelledSplit | None = None,
    subtypes: dict[int, int] | None = None,
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> DetectorEvaluation:
    """Evaluate detections on a split.

    Args:
        found: of this split and, for the best confidence, of the validation split; others are not looked at.
        validation: the split on which the best confidence is chosen.
        subtypes: reported subtypes of true regions, see `read_subtypes`.
        confidence: at which precision, recall, F1 and what rests on single detections are stated.
        resamples: of the bootstrap.

    Raises:
        PaveTwinError: a value is out of its bounds, or pycocotools is not installed.
    """
    check_evaluation(confidence, resamples, seed)
    mine = found_in(split, found)
    five, coarse = _both(split, mine)
    best = None
    if validation is not None and (there := found_in(validation, found)):
        best = best_confidence(_both(validation, there)[0])
    return DetectorEvaluation(
        split=split,
        five=five,
        coarse=coarse,
        total=len(mine),
        at_stated=scores_at(five, confidence),
        at_best=scores_at(five, best) if best is not None else None,
        subtypes_matched=subtypes_of_matched(coarse, confidence),
        subtypes_true=subtypes_of_true(split.images, subtypes) if subtypes is not None else None,
        confusion=confusion_matrix(five, confidence),
        breakdowns=tuple(breakdowns(five, confidence)),
        reliability=reliability(five, 0.0),
        reliability_in_use=reliability(five, confidence),
        intervals=intervals(metrics_of(five, coarse, confidence), _groups(split), resamples=resamples, seed=seed),
        sizes=tuple(size_errors(five, confidence)),
        severities=tuple(severity_agreements(five, confidence)),
    )


@dataclass(frozen=True)
class PairedComparison:
    """Two recipes on the same images."""

    differences: dict[str, ResampledDifference]
    """Metric → the second less the first."""
    first: tuple[Metrics, ...]
    """Metrics of each run."""
    second: tuple[Metrics, ...]


def found_in(split: LabelledSplit, found: Sequence[FoundBox]) -> list[FoundBox]:
    """The detections in images of a split."""
    numbers = {image.number for image in split.images}
    return [each for each in found if each.image in numbers]


def compare_in_pairs(
    split: LabelledSplit,
    first: Sequence[Sequence[FoundBox]],
    second: Sequence[Sequence[FoundBox]],
    *,
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> PairedComparison:
    """How much better the second recipe is than the first, metric by metric, each the mean over its runs.

    Args:
        first: the detections of each of its training runs; so `second`.

    Raises:
        PaveTwinError: a value is out of its bounds, or pycocotools is not installed.
    """
    check_evaluation(confidence, resamples, seed)
    one, other = (
        [metrics_of(*_both(split, found_in(split, each)), confidence) for each in runs] for runs in (first, second)
    )
    whole = np.ones(len(split.images))
    return PairedComparison(
        differences(one, other, _groups(split), resamples=resamples, seed=seed),
        tuple(each(whole) for each in one),
        tuple(each(whole) for each in other),
    )


def check_evaluation(confidence: float, resamples: int, seed: int) -> None:
    """Check values and packages before the detector runs.

    Raises:
        PaveTwinError: a value is out of its bounds, or pycocotools is not installed.
    """
    check_installed()
    if not 0.0 < confidence < 1.0:
        raise PaveTwinError(f"`confidence` {confidence:g}: it must be above 0 and below 1.")
    if not 0 <= resamples <= 100_000:
        raise PaveTwinError(f"`resamples` {resamples}: there are 0 to 100000.")
    if seed < 0:
        raise PaveTwinError(f"`seed` {seed}: it must be 0 or more.")


def _both(split: LabelledSplit, found: Sequence[FoundBox]) -> tuple[Matched, Matched]:
    kept = labelled_only(split.images, found)
    return match_five(split.images, kept), match_coarse(split.images, kept)


def _groups(split: LabelledSplit) -> tuple[str, ...]:
    return tuple(image.group for image in split.images)
