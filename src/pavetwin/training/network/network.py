"""The whole network: one encoding of an image, its heads, its computational cost, and detections from its output."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn
from torchvision.ops import batched_nms

from pavetwin.labels.class_names import ROAD_DEFECT, SUBTYPES
from pavetwin.training.network.architecture import REG_MAX, STRIDES, Architecture
from pavetwin.training.network.layers import REGION_STRIDE, Backbone, DetectionHead, Neck, RegionHead


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
