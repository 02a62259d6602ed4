"""The whole network: one encoding of the image, three heads."""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor, nn

from pavetwin.training.trainer.architecture import REG_MAX, Architecture
from pavetwin.training.trainer.heads import DetectionHead, RegionHead
from pavetwin.training.trainer.pyramid import Backbone, Neck


@dataclass(frozen=True, slots=True)
class Anchors:
    """The cells of all levels, in the order of `Architecture.strides`, row by row."""

    centres: Tensor
    """(anchors, 2) column, row in pixels of the image."""
    strides: Tensor
    """(anchors,) in pixels."""


@dataclass(frozen=True)
class Encoded:
    """What the detection head says of images, and the map that the heads of regions look at."""

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

    def images(self, which: slice) -> "Encoded":
        """The same of some of the batch's images."""
        return Encoded(self.distances[which], self.scores[which], self.anchors, self.maps[which])


class DetectorNetwork(nn.Module):
    """Backbone and neck once; then detection, and what is asked of regions."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        self.backbone = Backbone(architecture)
        self.neck = Neck(architecture)
        self.detection = DetectionHead(self.neck.outputs, architecture)
        self.regions = RegionHead(self.neck.outputs[architecture.strides.index(8)], architecture)

    def forward(self, images: Tensor) -> Encoded:
        """Args:
        images: (batch, 3, height, width) red, green, blue in 0 … 1; the sides are multiples of 32.
        """
        return self.encoded(images, *self.maps(images))

    def maps(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What `Encoded` holds but for the anchors: all that is computed of the images' pixels."""
        levels = self.neck(self.backbone(images))
        distances, scores = self.detection(levels)
        return distances, scores, levels[self.architecture.strides.index(8)]

    def encoded(self, images: Tensor, distances: Tensor, scores: Tensor, maps: Tensor) -> Encoded:
        """The maps of images with their anchors."""
        height, width = images.shape[-2:]
        shapes = [(height // stride, width // stride) for stride in self.architecture.strides]
        return Encoded(distances, scores, _anchors(shapes, self.architecture, images.device), maps)


def _anchors(shapes: list[tuple[int, int]], architecture: Architecture, device: torch.device) -> Anchors:
    centres, strides = [], []
    for (rows, columns), stride in zip(shapes, architecture.strides, strict=True):
        down, across = torch.meshgrid(
            torch.arange(rows, device=device), torch.arange(columns, device=device), indexing="ij"
        )
        centres.append((torch.stack([across, down], dim=-1).reshape(-1, 2) + 0.5) * stride)
        strides.append(torch.full((rows * columns,), float(stride), device=device))
    return Anchors(torch.cat(centres), torch.cat(strides))
