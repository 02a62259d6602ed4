"""The network: blocks, backbone, neck and heads of YOLOv8, its computational cost, and detections from its output.

Maps are (batch, channels, rows, columns). The neck carries coarse maps up to fine ones and back down (path aggregation,
Liu et al. 2018). Detection has a head on every level; subtype and mask of defects share one on the map of stride 8.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import batched_nms, roi_align

from pavetwin.labels.class_names import ROAD_DEFECT, SUBTYPES
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


POOLED: Final = 7  # Side of the sampled map of a box that the subtype head takes

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


@dataclass(frozen=True, slots=True)
class Anchors:
    """Cells of all levels, in the order of `STRIDES`, row by row."""

    centres: Tensor
    """(anchors, 2) column, row in pixels of the image."""
    strides: Tensor
    """(anchors,) in pixels."""


@dataclass(frozen=True)
class Encoded:
    """Output of the detection head, and the map from which regions are sampled."""

    distances: Tensor
    """(batch, anchors, 4, `REG_MAX`) logits: left, top, right, bottom."""
    scores: Tensor
    """(batch, anchors, classes) logits."""
    anchors: Anchors
    maps: Tensor
    """(batch, channels, rows, columns) of stride 8."""

    @cached_property
    def boxes(self) -> Tensor:
        """(batch, anchors, 4) left, top, right, bottom in pixels of the image, not clipped to it.

        A distance is the mean of its distribution (Li et al. 2020), in strides.
        """
        bins = torch.arange(REG_MAX, dtype=torch.float32, device=self.distances.device)
        reach = (self.distances.float().softmax(dim=-1) * bins).sum(dim=-1) * self.anchors.strides[:, None]
        return torch.cat([self.anchors.centres - reach[..., :2], self.anchors.centres + reach[..., 2:]], dim=-1)


class DetectorNetwork(nn.Module):
    """Backbone and neck, detection head, and heads of regions."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        self.backbone = Backbone(architecture)
        self.neck = Neck(architecture)
        self.detection = DetectionHead(self.neck.outputs, architecture)
        self.regions = RegionHead(self.neck.outputs[STRIDES.index(REGION_STRIDE)], architecture)

    def forward(self, images: Tensor) -> Encoded:
        """Args:
        images: (batch, 3, height, width) red, green, blue in 0 … 1; the sides are multiples of 32.
        """
        return self.encoded(images, *self.maps(images))

    def maps(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Distances, scores and maps of `Encoded`: everything that depends on the pixels."""
        levels = self.neck(self.backbone(images))
        distances, scores = self.detection(levels)
        return distances, scores, levels[STRIDES.index(REGION_STRIDE)]

    def encoded(self, images: Tensor, distances: Tensor, scores: Tensor, maps: Tensor) -> Encoded:
        """Output of `maps` with the anchors of the images."""
        height, width = images.shape[-2:]
        shapes = [(height // stride, width // stride) for stride in STRIDES]
        return Encoded(distances, scores, _anchors(shapes, images.device), maps)


def _anchors(shapes: list[tuple[int, int]], device: torch.device) -> Anchors:
    centres, strides = [], []
    for (rows, columns), stride in zip(shapes, STRIDES, strict=True):
        down, across = torch.meshgrid(
            torch.arange(rows, device=device), torch.arange(columns, device=device), indexing="ij"
        )
        centres.append((torch.stack([across, down], dim=-1).reshape(-1, 2) + 0.5) * stride)
        strides.append(torch.full((rows * columns,), float(stride), device=device))
    return Anchors(torch.cat(centres), torch.cat(strides))


def parameters(network: nn.Module) -> int:
    """Number of learned values."""
    return sum(each.numel() for each in network.parameters())


def gflops(network: DetectorNetwork, size_px: tuple[int, int] = (640, 640)) -> float:
    """Billions of operations of the convolutions for one image of (width, height).

    A multiplication with its addition counts as two operations, as in published figures. Batch normalisation is not
    counted, since it becomes part of a convolution; nor are the heads of regions, whose cost depends on the detections.
    """
    total = 0

    def count(module: nn.Module, _: Any, output: Any) -> None:
        nonlocal total
        assert isinstance(module, nn.Conv2d)
        rows, columns = module.kernel_size
        total += 2 * output.numel() * module.in_channels // module.groups * rows * columns

    hooks = [each.register_forward_hook(count) for each in network.modules() if isinstance(each, nn.Conv2d)]
    device = next(network.parameters()).device
    was_training = network.training
    try:
        with torch.no_grad():
            network.eval()(torch.zeros(1, 3, size_px[1], size_px[0], device=device))
    finally:
        network.train(was_training)
        for hook in hooks:
            hook.remove()
    return total / 1e9


@dataclass(frozen=True, slots=True)
class DetectLimits:
    """Limits on the detections that are kept."""

    confidence: float = 0.25
    """Minimum score of the coarse class."""
    overlap: float = 0.7
    """IoU above which the less confident of two boxes of a coarse class is dropped."""
    candidates: int = 3000
    """Maximum boxes of an image before duplicates are dropped, most confident first."""
    most: int = 300
    """Maximum boxes of an image."""


@dataclass(frozen=True, slots=True)
class ImageDetections:
    """Detections of one image, most confident first."""

    boxes: Tensor
    """(n, 4) left, top, right, bottom in pixels, clipped to the image."""
    coarse: Tensor
    """(n,) int64."""
    detection: Tensor
    """(n,) score of the coarse class, 0 … 1."""
    subtypes: Tensor
    """(n, 3) probabilities of a defect's subtypes; 0 for others."""
    masks: Tensor | None
    """(n, pixels, pixels) probabilities within the box, 0 for persons and cars; None without a mask head, or if masks
    were not requested."""

    @property
    def classes(self) -> Tensor:
        """(n,) most probable index into `CLASSES`."""
        is_defect = self.coarse == ROAD_DEFECT
        return torch.where(is_defect, self.subtypes.argmax(dim=1), self.coarse + len(SUBTYPES) - 1)

    @property
    def confidence(self) -> Tensor:
        """(n,) detection × subtype confidence for defects, detection confidence for others."""
        return torch.where(self.coarse == ROAD_DEFECT, self.subtypes.amax(dim=1), 1.0) * self.detection


@torch.no_grad()
def detect(
    network: DetectorNetwork, images: Tensor, limits: DetectLimits, *, masks: bool = True
) -> list[ImageDetections]:
    """Detections of each image of a batch (batch, 3, height, width) in 0 … 1; the network is in `eval` mode.

    Args:
        masks: whether to compute masks of defects, if the network has a mask head.
    """
    encoded = network(images)
    size = torch.tensor([images.shape[3], images.shape[2]] * 2, device=images.device, dtype=torch.float32)
    return [_of_image(network, encoded, image, size, limits, masks=masks) for image in range(len(images))]


def _of_image(
    network: DetectorNetwork, encoded: Encoded, image: int, size: Tensor, limits: DetectLimits, *, masks: bool
) -> ImageDetections:
    boxes = encoded.boxes[image].clamp(min=0).minimum(size)
    scores = encoded.scores[image].float().sigmoid()
    anchor, coarse = torch.nonzero(scores >= limits.confidence, as_tuple=True)
    order = scores[anchor, coarse].argsort(descending=True, stable=True)[: limits.candidates]
    anchor, coarse = anchor[order], coarse[order]
    found, confident = boxes[anchor], scores[anchor, coarse]
    kept = batched_nms(found, confident, coarse, limits.overlap)[: limits.most]
    found, coarse, confident = found[kept], coarse[kept], confident[kept]
    defect = torch.nonzero(coarse == ROAD_DEFECT).squeeze(1)
    regions = torch.cat([torch.full_like(found[defect, :1], image), found[defect]], dim=1)
    logits, mask_logits = network.regions(encoded.maps, regions, masks=masks)
    subtypes = found.new_zeros(len(found), len(SUBTYPES))
    subtypes[defect] = logits.float().softmax(dim=1)
    drawn = None
    if mask_logits is not None:
        drawn = found.new_zeros(len(found), *mask_logits.shape[1:])
        drawn[defect] = mask_logits.float().sigmoid()
    return ImageDetections(found, coarse, confident, subtypes, drawn)
