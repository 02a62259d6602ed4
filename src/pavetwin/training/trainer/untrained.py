"""Networks without training, whose size and speed are those of trained ones."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from pavetwin.files import writing
from pavetwin.perception.inference.model_file import ModelFacts
from pavetwin.training.trainer.architecture import Architecture, variant
from pavetwin.training.trainer.cost import gflops
from pavetwin.training.trainer.export import onnx_model
from pavetwin.training.trainer.network import DetectorNetwork


def export_untrained(size: str, target: Path) -> None:
    """Write the model of a published size with random weights, which finds nothing.

    Raises:
        PaveTwinError: there is no such size, or the file cannot be written.
    """
    architecture = variant(size)
    torch.manual_seed(0)
    network = DetectorNetwork(architecture).eval()
    facts = ModelFacts(mask_px=architecture.mask_px, architecture=architecture.as_mapping())
    content = onnx_model(network, facts).SerializeToString()
    with writing(target) as temporary:
        temporary.write_bytes(content)


def gflops_of(architecture: Mapping[str, Any]) -> float:
    """Billions of operations for one image of 640 × 640 px of the network that a model's file names."""
    return gflops(DetectorNetwork(Architecture(**architecture)))
