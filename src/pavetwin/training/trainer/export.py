"""Export of a network as one ONNX file: images in, boxes, classes, confidences and masks out.

PyTorch exports the encoder and the heads of regions; export_graph supplies the graph between them."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import onnx
import torch
from onnx import compose, helper
from torch import Tensor, nn
from torch.export import Dim

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.perception.model_file import OUTPUTS, ModelFacts
from pavetwin.training.network.architecture import STRIDES, Architecture, variant
from pavetwin.training.network.layers import REGION_STRIDE, RegionHead, pooled
from pavetwin.training.network.network import DetectLimits, DetectorNetwork, gflops
from pavetwin.training.trainer.export_graph import OPSET, answers, joined, store_in_half, suppression
from pavetwin.training.trainer.exported import exported_model, is_exported
from pavetwin.training.trainer.run_folder import BEST, SETTINGS, load_network

SIDE_STEP: Final = 32
"""Sides of images are multiples of this length, in pixels."""

_LARGEST_STEPS: Final = 512
"""Longest side of an image, in steps."""


class _Encoder(nn.Module):
    """Boxes, scores, and the map from which regions are sampled, of images (batch, rows, columns, 3) uint8."""

    def __init__(self, network: DetectorNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        encoded = self.network(images.permute(0, 3, 1, 2).float() / 255)
        rows, columns = images.shape[1], images.shape[2]
        sides = encoded.boxes.unbind(dim=2)
        boxes = torch.stack([side.clamp(0, limit) for side, limit in zip(sides, (columns, rows) * 2, strict=True)], 2)
        return boxes, encoded.scores.sigmoid(), encoded.maps


class _Regions(nn.Module):
    """Probabilities of subtypes, and masks if there is a head, of sampled regions (n, channels, points, points)."""

    def __init__(self, head: RegionHead) -> None:
        super().__init__()
        self.head = head

    def forward(self, sampled: Tensor) -> tuple[Tensor, ...]:
        subtypes = self.head.subtype(pooled(sampled)).softmax(dim=1)
        if self.head.mask is None:
            return (subtypes,)
        return subtypes, self.head.mask(sampled).squeeze(1).sigmoid()


def export(run: Path, target: Path, *, licence: str = "", half: bool = False) -> ModelFacts:
    """Write the ONNX file of the best weights of a run.

    Args:
        run: folder of a run, a file of weights, or an exported model, whose facts are kept.
        licence: licence of the weights to be stated in the file; by default that of an exported model.
        half: store the weights in half precision, which halves the size; computation stays in single precision.

    Raises:
        PaveTwinError: the weights are missing or damaged, or the file cannot be written.
    """
    if is_exported(run):
        network, facts = exported_model(run)
    else:
        weights = run / BEST if run.is_dir() else run
        network, content = load_network(weights)
        settings = weights.parent / SETTINGS
        recipe = sha256(settings.read_bytes()).hexdigest() if settings.is_file() else ""
        facts = replace(facts_of(network, content), recipe=recipe)
    facts = replace(facts, licence=licence or facts.licence)
    content = onnx_model(network, facts, half=half).SerializeToString()
    with writing(target) as temporary:
        temporary.write_bytes(content)
    return facts


def facts_of(network: DetectorNetwork, content: Mapping[str, Any]) -> ModelFacts:
    """Facts for an exported file, except recipe and licence.

    Args:
        content: other contents of the file of weights, from `load_network`.
    """
    options = content.get("options", {})
    return ModelFacts(
        classes=CLASS_LABELS,
        image_px=int(options.get("image_px", 640)),
        native=bool(options.get("native", False)),
        stride=SIDE_STEP,
        mask_px=network.architecture.mask_px if network.architecture.masks else 0,
        architecture=network.architecture.as_mapping(),
    )


def onnx_model(
    network: DetectorNetwork, facts: ModelFacts, *, limits: DetectLimits | None = None, half: bool = False
) -> Any:
    """ONNX model of a network that is on the processor and in `eval` mode.

    Args:
        limits: default limits; confidence and overlap are also inputs of the model.

    Raises:
        PaveTwinError: a weight is not finite.
    """
    if not all(torch.isfinite(each).all() for each in network.state_dict().values()):
        raise PaveTwinError("Some weights are not finite; export another run.")
    images = torch.zeros(2, 2 * SIDE_STEP, 3 * SIDE_STEP, 3, dtype=torch.uint8)
    steps = {name: SIDE_STEP * Dim(name, min=1, max=_LARGEST_STEPS) for name in ("down", "across")}
    encoder = _exported(
        _Encoder(network),
        images,
        {0: Dim("batch"), 1: steps["down"], 2: steps["across"]},
        ["images"],
        ["all_boxes", "scores", "maps"],
    )
    channels = network.neck.outputs[STRIDES.index(REGION_STRIDE)]
    sampled = torch.zeros(2, channels, network.regions.points, network.regions.points)
    names = ["of_subtypes", "of_masks"] if facts.mask_px else ["of_subtypes"]
    regions = _exported(_Regions(network.regions), sampled, {0: Dim("regions")}, ["sampled"], names)
    between = suppression(channels, network.regions.points, REGION_STRIDE, **asdict(limits or DetectLimits()))
    parts = (encoder, between, regions, answers(facts.mask_px))
    model = joined(parts, OUTPUTS if facts.mask_px else OUTPUTS[:-1])
    if half:
        store_in_half(model)
    helper.set_model_props(model, facts.as_properties())
    onnx.checker.check_model(model, full_check=True)
    return model


def _exported(module: nn.Module, example: Tensor, dims: dict[int, Any], inputs: list[str], outputs: list[str]) -> Any:
    program = torch.onnx.export(
        module.eval(),
        (example,),
        dynamo=True,
        dynamic_shapes=(dims,),
        input_names=inputs,
        output_names=outputs,
        opset_version=OPSET,
        external_data=False,
        verbose=False,
    )
    return compose.add_prefix(program.model_proto, f"{outputs[0]}/", rename_inputs=False, rename_outputs=False)


def export_untrained(size: str, target: Path) -> None:
    """Write the model of a published size with random weights, for measurements of size and speed.

    Raises:
        PaveTwinError: the size is unknown, or the file cannot be written.
    """
    architecture = variant(size)
    torch.manual_seed(0)
    network = DetectorNetwork(architecture).eval()
    facts = ModelFacts(mask_px=architecture.mask_px, architecture=architecture.as_mapping())
    content = onnx_model(network, facts).SerializeToString()
    with writing(target) as temporary:
        temporary.write_bytes(content)


def gflops_of(architecture: Mapping[str, Any]) -> float:
    """Billions of operations of an architecture for one image of 640 × 640 px."""
    return gflops(DetectorNetwork(Architecture(**architecture)))
