"""The network of an exported model, for further training.

An exported model has no batch normalisation: each is folded into the preceding convolution, as w' = w γ / √(v + ε) and
b' = β − m γ / √(v + ε). The mean m and the variance v of the normalised values are lost, and training needs them. So w'
becomes the convolution's weight, and the normalisation after it gets m and v as measured on training images,
γ = √(v + ε) and β = b' + m. Until it is trained, it only adds the bias.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from pavetwin.errors import PaveTwinError
from pavetwin.training.network.architecture import Architecture
from pavetwin.training.network.network import DetectorNetwork
from pavetwin.training.trainer.batches import Batch
from pavetwin.training.trainer.pictures import DevicePictures, images_of

if TYPE_CHECKING:
    from pavetwin.perception.model_file import ModelFacts

SUFFIX: Final = ".onnx"  # Suffix of exported models

_PARTS: Final = {"all_boxes/network.": "", "of_subtypes/head.": "regions."}
"""Prefixes of the names of weights in a model, and the corresponding ones in the network."""

_LAYERS: Final = ("Conv", "ConvTranspose", "Gemm")


def is_exported(path: Path) -> bool:
    """Return whether a file has the suffix of an exported model."""
    return path.suffix.lower() == SUFFIX


def exported_model(path: Path) -> "tuple[DetectorNetwork, ModelFacts]":
    """The network of an exported model, in `eval` mode with the same output, and the facts in the file.

    Its normalisations have mean 0 and variance 1 until `measure_normalisations` sets them.

    Raises:
        PaveTwinError: the file is damaged, another model or of another version; or `onnx` is not installed.
    """
    # A training without an exported model needs none of these packages.
    from pavetwin.perception.model_file import ModelFacts

    model = _read(path)
    facts = ModelFacts.of_properties({each.key: each.value for each in model.metadata_props}, f"'{path}'")
    try:
        network = DetectorNetwork(Architecture(**facts.architecture)).eval()
        weights = _weights(model, network)
        for name in weights.keys() ^ network.state_dict().keys():
            raise KeyError(name)
        network.load_state_dict(weights)
    except (KeyError, TypeError, ValueError, RuntimeError, PaveTwinError) as error:
        raise PaveTwinError(f"'{path}' holds no weights of a detector of this version.") from error
    return network, facts


def _read(path: Path) -> Any:
    try:
        import onnx
    except ImportError as error:
        raise PaveTwinError(
            f"Reading the weights of '{path}' needs onnx, an extra; install it with `pip install pavetwin[train]`."
        ) from error
    try:
        model = onnx.load(path)
        onnx.checker.check_model(model)
    # Its exceptions share no other base class.
    except Exception as error:
        raise PaveTwinError(f"'{path}' is damaged, or not an ONNX model.") from error
    return model


def _weights(model: Any, network: DetectorNetwork) -> dict[str, Tensor]:
    """State of the network: the weights of the model, and normalisations that only add a bias."""
    values, found = _values(model), dict[str, Tensor]()
    norms = {name: each for name, each in network.named_modules() if isinstance(each, nn.BatchNorm2d)}
    for node in model.graph.node:
        if node.op_type not in _LAYERS:
            continue
        name = _name_in_network(node.input[1])
        found[f"{name}.weight"] = values[node.input[1]]
        bias = values[node.input[2]] if len(node.input) > 2 else None
        norm_name = f"{name.removesuffix('.conv')}.norm"
        if norm_name in norms:
            norm = norms[norm_name]
            count = norm.num_features
            found[f"{norm_name}.weight"] = torch.full((count,), (1 + norm.eps) ** 0.5)
            found[f"{norm_name}.bias"] = torch.zeros(count) if bias is None else bias
            found[f"{norm_name}.running_mean"] = torch.zeros(count)
            found[f"{norm_name}.running_var"] = torch.ones(count)
            found[f"{norm_name}.num_batches_tracked"] = torch.zeros((), dtype=torch.int64)
        elif bias is not None:
            found[f"{name}.bias"] = bias
    return found


def _values(model: Any) -> dict[str, Tensor]:
    """Constants of a model by name, in single precision, including those that it casts."""
    from onnx import numpy_helper

    found = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "Cast" and node.input[0] in found:
            found[node.output[0]] = found[node.input[0]]
    return {
        name: torch.from_numpy(value.astype(np.float32)) for name, value in found.items() if value.dtype.kind == "f"
    }


def _name_in_network(weight: str) -> str:
    """Name of the layer in the network to which a weight of the model belongs.

    Raises:
        ValueError: it belongs to no layer of a detector.
    """
    for begins, instead in _PARTS.items():
        if weight.startswith(begins) and weight.endswith(".weight"):
            return instead + weight.removeprefix(begins).removesuffix(".weight")
    raise ValueError(weight)


@torch.no_grad()
def measure_normalisations(
    network: DetectorNetwork, batches: Iterable[Batch], pictures: DevicePictures | None = None
) -> None:
    """Set mean and variance of each normalisation to those of its inputs, without a change of the network's output.

    Args:
        network: a network of `exported_model`.
        batches: training images. Without regions among them, the heads of regions stay unchanged.
        pictures: images on the device, if the batches hold drawing instructions.
    """
    norms = [each for each in network.modules() if isinstance(each, nn.BatchNorm2d)]
    device = next(network.parameters()).device
    sums = {each: torch.zeros(3, each.num_features, dtype=torch.float64, device=device) for each in norms}

    def add(norm: nn.Module, given: tuple[Tensor]) -> None:
        values = given[0].detach().transpose(0, 1).flatten(1).double()
        assert isinstance(norm, nn.BatchNorm2d)
        sums[norm] += torch.stack(
            [values.new_full((len(values),), values.shape[1]), values.sum(1), values.square().sum(1)]
        )

    hooks = [each.register_forward_pre_hook(add) for each in norms]
    network.eval()
    try:
        for batch in batches:
            images = images_of(batch.images, device, pictures)
            regions = batch.targets.regions.to(device)
            encoded = network(images)
            if len(regions):
                network.regions(encoded.maps, regions)
    finally:
        for hook in hooks:
            hook.remove()
    for norm, (count, total, squares) in sums.items():
        if count[0] == 0:
            continue
        mean = total / count
        variance = (squares / count - mean.square()).clamp(min=0)
        # From the stored values, so that scale and statistics agree to the last bit.
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_((norm.running_var.double() + norm.eps).sqrt())
        norm.bias.add_(norm.running_mean)
