"""Building blocks of the backbone and the neck. Maps are (batch, channels, rows, columns)."""

import torch
from torch import Tensor, nn

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
    """Two 3 × 3 convolutions of the same number of channels, added to the input where `shortcut` says so."""

    def __init__(self, channels: int, *, shortcut: bool, activation: str) -> None:
        super().__init__()
        self.first = ConvUnit(channels, channels, 3, activation=activation)
        self.second = ConvUnit(channels, channels, 3, activation=activation)
        self.shortcut = shortcut

    def forward(self, maps: Tensor) -> Tensor:
        outputs = self.second(self.first(maps))
        return maps + outputs if self.shortcut else outputs


class CrossStage(nn.Module):
    """C2f: the input in two halves; one passes through a chain of bottlenecks, of which every output is kept."""

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
    """SPPF: three poolings of 5 × 5 one after the other, which see 5, 9 and 13 cells, beside their input."""

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
