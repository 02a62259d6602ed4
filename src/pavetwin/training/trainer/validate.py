"""Average precision of a network on validation images."""

from collections.abc import Iterable

import torch

from pavetwin.arrays import Float64Array
from pavetwin.perception.classes import CLASSES, coarse_of_classes
from pavetwin.training.evaluation.average_precision import Scored, average_precision
from pavetwin.training.trainer.batches import Batch
from pavetwin.training.trainer.detect import DetectLimits, ImageDetections, detect
from pavetwin.training.trainer.device_pictures import images_of
from pavetwin.training.trainer.network import DetectorNetwork

LIMITS = DetectLimits(confidence=0.001)
"""Nearly everything is kept: average precision reads the whole curve."""


def validate(network: DetectorNetwork, batches: Iterable[Batch], device: torch.device) -> Float64Array:
    """(five classes, thresholds) average precision; NaN for a class of which there is no object.

    Classes that are not labelled in an image are left out there.
    """
    scored = []
    for batch in batches:
        for at, found in enumerate(detect(network, images_of(batch.images, device), LIMITS, masks=False)):
            scored.append(_scored(found, batch, at))
    return average_precision(scored, len(CLASSES))


def _scored(found: ImageDetections, batch: Batch, image: int) -> Scored:
    known = batch.targets.known[image].numpy()
    rows = batch.targets.images == image
    classes = found.classes.cpu().numpy()
    told = known[coarse_of_classes(classes)]
    return Scored(
        boxes=found.boxes.cpu().double().numpy()[told],
        classes=classes[told],
        confidence=found.confidence.cpu().double().numpy()[told],
        true_boxes=batch.targets.boxes[rows].double().numpy(),
        true_classes=batch.final[rows].numpy(),
        ignored=batch.targets.ignored[rows].numpy(),
    )
