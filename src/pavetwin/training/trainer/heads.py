"""The three heads: detection on every level, and subtype and mask of defects on the map of stride 8."""

from collections.abc import Sequence
from math import log
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import roi_align

from pavetwin.perception.classes import SUBTYPES
from pavetwin.training.trainer.architecture import REG_MAX, Architecture
from pavetwin.training.trainer.blocks import ConvUnit

POOLED: Final = 7
"""Side of the map that the subtype head sees of a box."""

REGION_STRIDE: Final = 8
"""Of the map from which boxes are cut."""

_BIN_FALL: Final = 0.3
"""Difference between the first logits of one bin of a distance and the next: the first boxes are about 5 strides wide.
Equal bins, as published for YOLOv8, make them 15 strides wide. An object counts in the loss of boxes by the overlap of
the boxes predicted for it, so that small objects would begin with nearly no share of it, and be learned very late."""

_PRIOR_OBJECTS: Final = 5
"""Objects in an image of 640 px before anything is learned; the bias of the class scores says so."""


class DetectionHead(nn.Module):
    """At every cell of every level: the distribution of the distances to the four sides, and the class scores."""

    def __init__(self, inputs: Sequence[int], it: Architecture) -> None:
        super().__init__()
        for_boxes = max(16, inputs[0] // 4, 4 * REG_MAX)
        for_classes = max(inputs[0], min(it.classes, 100))
        widths = [(for_boxes, for_classes)] * len(inputs)
        if it.p2:
            # It has four times the cells of the next level, so it is as narrow as its map.
            widths[-1] = (inputs[-1], inputs[-1])
        self.boxes = nn.ModuleList(
            _branch(each, hidden, 4 * REG_MAX, it.activation) for each, (hidden, _) in zip(inputs, widths, strict=True)
        )
        self.classes = nn.ModuleList(
            _branch(each, hidden, it.classes, it.activation) for each, (_, hidden) in zip(inputs, widths, strict=True)
        )
        for boxes, classes, stride in zip(self.boxes, self.classes, it.strides, strict=True):
            boxes[-1].bias.data = (-_BIN_FALL * torch.arange(REG_MAX)).repeat(4)
            nn.init.constant_(classes[-1].bias, log(_PRIOR_OBJECTS / it.classes / (640 / stride) ** 2))

    def forward(self, levels: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Logits (batch, anchors, 4, `REG_MAX`) of the distances, and (batch, anchors, classes)."""
        distances, scores = [], []
        for maps, boxes, classes in zip(levels, self.boxes, self.classes, strict=True):
            distances.append(boxes(maps).flatten(2))
            scores.append(classes(maps).flatten(2))
        sides = torch.cat(distances, dim=2).transpose(1, 2)
        return sides.unflatten(2, (4, REG_MAX)), torch.cat(scores, dim=2).transpose(1, 2)


def _branch(inputs: int, hidden: int, outputs: int, activation: str) -> nn.Sequential:
    return nn.Sequential(
        ConvUnit(inputs, hidden, 3, activation=activation),
        ConvUnit(hidden, hidden, 3, activation=activation),
        nn.Conv2d(hidden, outputs, 1),
    )


class RegionHead(nn.Module):
    """What is in a box: the subtype of a defect, and its mask, both of the same sampled points."""

    def __init__(self, inputs: int, it: Architecture) -> None:
        super().__init__()
        self.points = it.mask_points if it.masks else POOLED
        hidden = max(32, inputs)
        self.subtype = nn.Sequential(
            ConvUnit(inputs, hidden, 3, activation=it.activation),
            ConvUnit(hidden, hidden, 3, activation=it.activation),
            nn.AdaptiveAvgPool2d(1),
            nn.Flatten(),
            nn.Linear(hidden, len(SUBTYPES)),
        )
        self.mask = _mask_head(inputs, it.activation) if it.masks else None

    def forward(self, maps: Tensor, boxes: Tensor, *, masks: bool = True) -> tuple[Tensor, Tensor | None]:
        """Logits (boxes, subtypes), and (boxes, pixels, pixels) where there is a mask head.

        Args:
            maps: of stride 8.
            boxes: (boxes, 5) index of the image, left, top, right, bottom in pixels of the image.
            masks: whether to draw them, which takes most of the time.
        """
        sampled = sample_regions(maps, boxes, self.points)
        mask = self.mask(sampled).squeeze(1) if masks and self.mask is not None else None
        return self.subtype(pooled(sampled)), mask


def sample_regions(maps: Tensor, boxes: Tensor, points: int) -> Tensor:
    """ROIAlign (He et al. 2017) with one sample a point: (boxes, channels, points, points).

    In single precision: half precision would round the edges of boxes to several pixels.
    """
    return roi_align(
        maps.float(), boxes.float(), (points, points), spatial_scale=1 / REGION_STRIDE, sampling_ratio=1, aligned=True
    )


def pooled(sampled: Tensor) -> Tensor:
    """The 7 × 7 map of a box. The mean of n × n points is what ROIAlign of 7 × 7 with a sampling ratio of n gives."""
    return functional.avg_pool2d(sampled, sampled.shape[-1] // POOLED)


def _mask_head(inputs: int, activation: str) -> nn.Sequential:
    hidden = max(32, inputs // 2)
    return nn.Sequential(
        ConvUnit(inputs, hidden, 3, activation=activation),
        ConvUnit(hidden, hidden, 3, activation=activation),
        nn.ConvTranspose2d(hidden, hidden, 2, 2),
        nn.ReLU(inplace=True),
        nn.Conv2d(hidden, 1, 1),
    )
