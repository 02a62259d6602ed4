"""What a network costs: parameters, and operations for one image."""

from typing import Any

import torch
from torch import nn

from pavetwin.training.trainer.network import DetectorNetwork


def parameters(network: nn.Module) -> int:
    """Numbers that are learned."""
    return sum(each.numel() for each in network.parameters())


def gflops(network: DetectorNetwork, size_px: tuple[int, int] = (640, 640)) -> float:
    """Billions of operations of the convolutions for one image of (width, height), two for each multiplication with its
    addition, as published figures count them. Batch normalisation counts nothing: in use it is part of a convolution.
    The heads of regions are left out, since they depend on what is found.
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
