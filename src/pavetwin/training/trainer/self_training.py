"""Self-training on unlabelled photographs by a mean teacher (Tarvainen and Valpola 2017; for detectors Liu et al. 2021,
"Unbiased Teacher").

The teacher is the moving average of the network. It looks at a photograph as it is, the network at the same view with
strongly varied colours, blur and holes. Detections of which the teacher is sure are the network's targets there. Those
of which it is less sure are neither objects nor background. A class of which it is sure of nothing in a photograph is
not judged there: early on the teacher finds next to nothing on photographs, and would teach that they are empty.

As in Liu et al., boxes are not learned from the teacher, whose confidence does not say how well they fit: the loss is
that of the class scores and of the subtypes.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import torch
from PIL import Image, ImageFilter
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from pavetwin.arrays import UInt8Array
from pavetwin.perception.classes import COARSE, NO_SUBTYPE, ROAD_DEFECT
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.trainer.augment import Member, ViewOptions, random_view, vary_colours
from pavetwin.training.trainer.batches import read, tensor_of
from pavetwin.training.trainer.detect import DetectLimits, detect
from pavetwin.training.trainer.losses import detection_losses, subtype_loss
from pavetwin.training.trainer.network import DetectorNetwork, Encoded
from pavetwin.training.trainer.options import LossWeights, TrainingOptions
from pavetwin.training.trainer.targets import Targets
from pavetwin.training.trainer.views import GREY

STRONG: Final[dict[str, Any]] = {"hue": 0.05, "saturation": 0.9, "brightness": 0.5}
"""How much colours vary in what the network sees."""

GREY_SHARE: Final = 0.2
"""Of views that lose their colours; as published."""

BLUR_SHARE: Final = 0.5
MOST_BLUR_PX: Final = 1.0
"""Half of what is published: a crack may be two pixels wide."""

HOLES: Final = 3
"""Rectangles that are hidden, at most."""
HOLE_SIDE: Final = (0.05, 0.2)
"""Their sides, as shares of the view's."""


class PhotographViews(Dataset[tuple[Tensor, Tensor]]):
    """Views of photographs for an epoch: as they are, and strongly varied; each (3, height, width) uint8."""

    def __init__(self, photographs: ExampleSet, options: ViewOptions, count: int, key: tuple[int, ...]) -> None:
        """Args:
        key: seed, phase and epoch.
        """
        self._members: list[Member] = [(photographs, each) for each in photographs.examples]
        self._options = replace(options, mosaic=0.0, hue=0.0, saturation=0.0, brightness=0.0)
        self._count, self._key = count, key

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        seed, *keys = self._key
        rng = child(seed, Stream.PHOTOGRAPHS, *keys, index)
        member = self._members[int(rng.integers(len(self._members)))]
        pixels = random_view(member, self._members, self._options, rng).pixels
        return tensor_of(pixels), tensor_of(strongly_varied(pixels, self._options, rng))


def strongly_varied(pixels: UInt8Array, options: ViewOptions, rng: np.random.Generator) -> UInt8Array:
    """The view with other colours, mostly less sharp, and with holes; nothing moves."""
    changed = Image.fromarray(vary_colours(pixels, replace(options, **STRONG), rng))
    if rng.random() < GREY_SHARE:
        changed = changed.convert("L").convert("RGB")
    if rng.random() < BLUR_SHARE:
        changed = changed.filter(ImageFilter.GaussianBlur(rng.uniform(0.1, MOST_BLUR_PX)))
    held = np.array(changed)
    height, width = held.shape[:2]
    for _ in range(int(rng.integers(HOLES + 1))):
        down, across = (max(1, round(side * rng.uniform(*HOLE_SIDE))) for side in (height, width))
        top, left = int(rng.integers(height - down + 1)), int(rng.integers(width - across + 1))
        held[top : top + down, left : left + across] = GREY
    return held


class MeanTeacher:
    """What is learned from unlabelled photographs."""

    def __init__(self, photographs: ExampleSet, options: TrainingOptions, known: frozenset[int]) -> None:
        """Args:
        known: coarse classes that the labelled images have; the teacher knows no others.
        """
        self._photographs, self._options = photographs, options
        self._known = torch.tensor([at in known for at in range(len(COARSE))])

    def views(self, key: tuple[int, ...], steps: int, first: int, workers: int) -> Iterator[list[Tensor]]:
        """Of each step of an epoch from the `first` on, the views as they are and varied: (photographs, 3, …) each.

        Args:
            key: seed, phase and epoch.
        """
        size = self._options.teacher_photographs
        views = PhotographViews(self._photographs, self._options.views(mosaic=False), steps * size, key)
        groups = [list(range(step * size, (step + 1) * size)) for step in range(first, steps)]
        pinned = torch.cuda.is_available()
        yield from read(DataLoader(views, batch_sampler=groups, num_workers=workers, pin_memory=pinned))

    def targets(self, teacher: DetectorNetwork, images: Tensor) -> Targets:
        """What the teacher says of views as they are.

        Args:
            teacher: in `eval` mode.
            images: (photographs, 3, height, width) in 0 … 1.
        """
        options = self._options
        limits = DetectLimits(confidence=max(options.teacher_doubt, 1e-3))
        found = detect(teacher, images, limits, masks=False)
        counts = torch.tensor([len(each.boxes) for each in found], device=images.device)
        image = torch.repeat_interleave(torch.arange(len(found), device=images.device), counts)
        boxes, classes = torch.cat([each.boxes for each in found]), torch.cat([each.coarse for each in found])
        is_sure = torch.cat([each.detection for each in found]) >= options.teacher_confidence
        known = torch.zeros(len(found), len(COARSE), dtype=torch.bool, device=images.device)
        known[image[is_sure], classes[is_sure]] = True
        defect = is_sure & (classes == ROAD_DEFECT)
        sure, subtypes = torch.cat([each.subtypes for each in found])[defect].max(dim=1)
        side = teacher.architecture.mask_px
        return Targets(
            boxes=boxes,
            classes=classes,
            images=image,
            ignored=~is_sure,
            known=known & self._known.to(images.device),
            regions=torch.cat([image[defect][:, None].float(), boxes[defect]], dim=1),
            subtypes=torch.where(sure >= options.teacher_confidence, subtypes, NO_SUBTYPE),
            masks=images.new_zeros(len(sure), side, side),
            has_mask=torch.zeros(len(sure), dtype=torch.bool, device=images.device),
        )

    def loss(self, network: DetectorNetwork, encoded: Encoded, targets: Targets, weights: LossWeights) -> Tensor:
        """On the varied views, a scalar, not weighted by `teacher_weight` yet."""
        _, classes, _ = detection_losses(encoded, targets)
        loss = weights.classes * classes
        if len(targets.regions):
            logits, _ = network.regions(encoded.maps, targets.regions)
            loss = loss + weights.subtype * subtype_loss(logits, targets.subtypes)
        return loss
