"""Layers of a YOLOv8 network: blocks, backbone, neck and heads. Maps are (batch, channels, rows, columns).

The backbone consists of cross-stage blocks. The neck carries coarse maps up to fine ones and back down (path
aggregation, Liu et al. 2018). Detection has a head on every level; subtype and mask of defects share one on the map of
stride 8."""

from collections.abc import Sequence
from math import log
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import roi_align

from pavetwin.labels.class_names import SUBTYPES
from pavetwin.training.network.architecture import REG_MAX, STRIDES, Architecture

_ACTIVATIONS = {"silu": nn.SiLU, "relu": nn.ReLU}


class ConvUnit(nn.Module):
    """Convolution without bias, batch normalisation, activation."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 1, stride: int = 1, *, activation: str) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, bias=False)
        self.norm = nn.BatchNorm2d(outputs, eps=1e-3)
        self.act = _ACTIVATIONS[activation](inplace=True)

    def forward(self, maps: Tensor) -> Tensor:
        return self.act(self.norm(self.conv(maps)))


class Bottleneck(nn.Module):
    """Two 3 × 3 convolutions with equal numbers of channels; `shortcut` adds their output to the input."""

    def __init__(self, channels: int, *, shortcut: bool, activation: str) -> None:
        super().__init__()
        self.first = ConvUnit(channels, channels, 3, activation=activation)
        self.second = ConvUnit(channels, channels, 3, activation=activation)
        self.shortcut = shortcut

    def forward(self, maps: Tensor) -> Tensor:
        outputs = self.second(self.first(maps))
        return maps + outputs if self.shortcut else outputs


class CrossStage(nn.Module):
    """C2f: one half of the input passes through a chain of bottlenecks, and every output is kept."""

    def __init__(self, inputs: int, outputs: int, count: int, *, shortcut: bool, activation: str) -> None:
        super().__init__()
        self.half = outputs // 2
        self.enter = ConvUnit(inputs, 2 * self.half, activation=activation)
        self.chain = nn.ModuleList(
            Bottleneck(self.half, shortcut=shortcut, activation=activation) for _ in range(count)
        )
        self.leave = ConvUnit((2 + count) * self.half, outputs, activation=activation)

    def forward(self, maps: Tensor) -> Tensor:
        kept = list(self.enter(maps).split(self.half, dim=1))
        for bottleneck in self.chain:
            kept.append(bottleneck(kept[-1]))
        return self.leave(torch.cat(kept, dim=1))


class PyramidPooling(nn.Module):
    """SPPF: three successive 5 × 5 poolings, with fields of 5, 9 and 13 cells, concatenated with their input."""

    def __init__(self, inputs: int, outputs: int, *, activation: str) -> None:
        super().__init__()
        self.enter = ConvUnit(inputs, inputs // 2, activation=activation)
        self.pool = nn.MaxPool2d(5, stride=1, padding=2)
        self.leave = ConvUnit(inputs // 2 * 4, outputs, activation=activation)

    def forward(self, maps: Tensor) -> Tensor:
        kept = [self.enter(maps)]
        for _ in range(3):
            kept.append(self.pool(kept[-1]))
        return self.leave(torch.cat(kept, dim=1))


_STEM = 64
_STAGES = ((128, 3), (256, 6), (512, 6), (1024, 3))
"""Channels and blocks of the maps of stride 4, 8, 16 and 32, at width and depth 1."""

_NECK_BLOCKS = 3


class Backbone(nn.Module):
    """Maps of stride 8, 16 and 32 of images (batch, 3, height, width) in 0 … 1."""

    def __init__(self, it: Architecture) -> None:
        super().__init__()
        before = it.channels(_STEM)
        self.stem = ConvUnit(3, before, 3, 2, activation=it.activation)
        self.stages = nn.ModuleList()
        for base, blocks in _STAGES:
            channels = it.channels(base)
            down = ConvUnit(before, channels, 3, 2, activation=it.activation)
            stage = CrossStage(channels, channels, it.blocks(blocks), shortcut=True, activation=it.activation)
            self.stages.append(nn.Sequential(down, stage))
            before = channels
        self.pooling = PyramidPooling(before, before, activation=it.activation)

    def forward(self, images: Tensor) -> list[Tensor]:
        maps, found = self.stem(images), []
        for stage in self.stages:
            maps = stage(maps)
            found.append(maps)
        return [*found[1:-1], self.pooling(found[-1])]


class Neck(nn.Module):
    """One map for each detection level, in the order of `STRIDES`, from the maps of the backbone."""

    def __init__(self, it: Architecture) -> None:
        super().__init__()
        channels = self.outputs = [it.channels(base) for base, _ in _STAGES[1:]]

        def block(inputs: int, outputs: int) -> CrossStage:
            return CrossStage(inputs, outputs, it.blocks(_NECK_BLOCKS), shortcut=False, activation=it.activation)

        upwards, downwards = reversed(range(len(channels) - 1)), range(len(channels) - 1)
        self.up = nn.ModuleList(block(channels[at + 1] + channels[at], channels[at]) for at in upwards)
        self.shrink = nn.ModuleList(
            ConvUnit(channels[at], channels[at], 3, 2, activation=it.activation) for at in downwards
        )
        self.down = nn.ModuleList(block(channels[at] + channels[at + 1], channels[at + 1]) for at in downwards)

    def forward(self, maps: Sequence[Tensor]) -> list[Tensor]:
        carried = [maps[-1]]
        for block, finer in zip(self.up, reversed(maps[:-1]), strict=True):
            larger = functional.interpolate(carried[-1], scale_factor=2.0, mode="nearest")
            carried.append(block(torch.cat([larger, finer], dim=1)))
        found = [carried.pop()]
        for shrink, block in zip(self.shrink, self.down, strict=True):
            found.append(block(torch.cat([shrink(found[-1]), carried.pop()], dim=1)))
        return found


POOLED: Final = 7
"""Side of the sampled map of a box that the subtype head takes."""

REGION_STRIDE: Final = 8
"""Stride of the map from which regions are sampled."""

_BIN_FALL: Final = 0.3
"""Initial difference between the logits of successive bins of a distance, which makes the first boxes about 5 strides
wide. Equal bins, as published for YOLOv8, make them 15 strides wide. The box loss weights an object by the overlap of
its predicted boxes, so with equal bins small objects are learned very late."""

_PRIOR_OBJECTS: Final = 5
"""Expected objects in an image of 640 px before training, from which the bias of the class scores follows."""


class DetectionHead(nn.Module):
    """Distribution of the distances to the four sides, and class scores, in every cell of every level."""

    def __init__(self, inputs: Sequence[int], it: Architecture) -> None:
        super().__init__()
        for_boxes = max(16, inputs[0] // 4, 4 * REG_MAX)
        for_classes = max(inputs[0], min(it.classes, 100))
        self.boxes = nn.ModuleList(_branch(each, for_boxes, 4 * REG_MAX, it.activation) for each in inputs)
        self.classes = nn.ModuleList(_branch(each, for_classes, it.classes, it.activation) for each in inputs)
        for boxes, classes, stride in zip(self.boxes, self.classes, STRIDES, strict=True):
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
    """Subtype and mask of the defect in a box, from the same sampled points."""

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
        """Logits (boxes, subtypes), and (boxes, pixels, pixels) or None without a mask head.

        Args:
            maps: of stride 8.
            boxes: (boxes, 5) index of the image, left, top, right, bottom in pixels of the image.
            masks: whether to compute masks, which takes most of the time.
        """
        sampled = sample_regions(maps, boxes, self.points)
        mask = self.mask(sampled).squeeze(1) if masks and self.mask is not None else None
        return self.subtype(pooled(sampled)), mask


def sample_regions(maps: Tensor, boxes: Tensor, points: int) -> Tensor:
    """ROIAlign (He et al. 2017) with one sample a point: (boxes, channels, points, points).

    Computed in single precision, since half precision would round the edges of boxes to several pixels.
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
