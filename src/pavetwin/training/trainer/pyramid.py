"""Backbone and neck: an image becomes one map for each stride.

The network of the YOLOv8 family: a backbone of cross-stage blocks, and a neck that carries coarse maps up to fine ones
and back down (path aggregation, Liu et al. 2018).
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from pavetwin.training.trainer.architecture import Architecture
from pavetwin.training.trainer.blocks import ConvUnit, CrossStage, PyramidPooling

_STEM = 64
_STAGES = ((128, 3), (256, 6), (512, 6), (1024, 3))
"""Channels and blocks of the maps of stride 4, 8, 16 and 32, at width and depth 1."""

_NECK_BLOCKS = 3


class Backbone(nn.Module):
    """An image (batch, 3, height, width) in 0 … 1 → its maps of stride 4, 8, 16 and 32."""

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
        found[-1] = self.pooling(found[-1])
        return found


class Neck(nn.Module):
    """The backbone's maps → one for each detection level, in the order of `Architecture.strides`.

    A map of stride 4 is carried up like the others, and no further: nothing is carried down from it. So a network
    without it is a part of the network with it, and says the same on its three levels.
    """

    def __init__(self, it: Architecture) -> None:
        super().__init__()
        channels = [it.channels(base) for base, _ in _STAGES]
        self.finest = 0 if it.p2 else 1
        self.outputs = channels[1:] + channels[self.finest : 1]

        def block(inputs: int, outputs: int) -> CrossStage:
            return CrossStage(inputs, outputs, it.blocks(_NECK_BLOCKS), shortcut=False, activation=it.activation)

        upwards, downwards = reversed(range(self.finest, len(channels) - 1)), range(1, len(channels) - 1)
        self.up = nn.ModuleList(block(channels[at + 1] + channels[at], channels[at]) for at in upwards)
        self.shrink = nn.ModuleList(
            ConvUnit(channels[at], channels[at], 3, 2, activation=it.activation) for at in downwards
        )
        self.down = nn.ModuleList(block(channels[at] + channels[at + 1], channels[at + 1]) for at in downwards)

    def forward(self, maps: Sequence[Tensor]) -> list[Tensor]:
        carried = [maps[-1]]
        for block, finer in zip(self.up, reversed(maps[self.finest : -1]), strict=True):
            larger = functional.interpolate(carried[-1], scale_factor=2.0, mode="nearest")
            carried.append(block(torch.cat([larger, finer], dim=1)))
        fine = [carried.pop()] if self.finest == 0 else []
        found = [carried.pop()]
        for shrink, block in zip(self.shrink, self.down, strict=True):
            found.append(block(torch.cat([shrink(found[-1]), carried.pop()], dim=1)))
        return found + fine
