"""One ONNX file of a trained network: images in, boxes, classes, confidences and masks out.

PyTorch exports the encoder and the heads of regions; what lies between them is `export_graph`.
"""

from collections.abc import Mapping, Sequence
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
from pavetwin.perception.classes import CLASSES
from pavetwin.perception.inference.model_file import OUTPUTS, ModelFacts
from pavetwin.training.trainer.averaging import averaged_network, weights_of
from pavetwin.training.trainer.detect import DetectLimits
from pavetwin.training.trainer.export_graph import OPSET, answers, joined, store_in_half, suppression
from pavetwin.training.trainer.exported import exported_model, is_exported
from pavetwin.training.trainer.heads import REGION_STRIDE, RegionHead, pooled
from pavetwin.training.trainer.network import DetectorNetwork
from pavetwin.training.trainer.run_folder import SETTINGS

SIDE_STEP: Final = 32
"""Sides of images are multiples of it."""

_LARGEST_STEPS: Final = 512
"""Longest side of an image, in such steps."""


class _Encoder(nn.Module):
    """Images as they are stored → boxes, scores, and the map that regions are cut from."""

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
    """Sampled regions (n, channels, points, points) → probabilities of subtypes, and masks where there is a head."""

    def __init__(self, head: RegionHead) -> None:
        super().__init__()
        self.head = head

    def forward(self, sampled: Tensor) -> tuple[Tensor, ...]:
        subtypes = self.head.subtype(pooled(sampled)).softmax(dim=1)
        if self.head.mask is None:
            return (subtypes,)
        return subtypes, self.head.mask(sampled).squeeze(1).sigmoid()


def export(runs: Path | Sequence[Path], target: Path, *, licence: str = "", half: bool = False) -> ModelFacts:
    """Write the ONNX file of a run's best weights, or of a file of weights; of several, with the mean of their weights.

    Args:
        runs: one may be an exported model, of which another file is made: it keeps what the model says of itself.
        licence: of the weights, as the file shall say it; unless given, as an exported model says it.
        half: store the weights in half precision: half the size; they are computed with in single precision.

    Raises:
        PaveTwinError: there are no weights, they are damaged, a mean cannot be made of them (`averaged_network`), or
            the file cannot be written.
    """
    given = [runs] if isinstance(runs, Path) else list(runs)
    if len(given) == 1 and is_exported(given[0]):
        network, facts = exported_model(given[0])
    else:
        network, told = averaged_network(given)
        settings = [weights_of(run).parent / SETTINGS for run in given]
        is_known = all(each.is_file() for each in settings)
        recipe = sha256(b"".join(each.read_bytes() for each in settings)).hexdigest() if is_known else ""
        facts = replace(facts_of(network, told), recipe=recipe)
    facts = replace(facts, licence=licence or facts.licence)
    content = onnx_model(network, facts, half=half).SerializeToString()
    with writing(target) as temporary:
        temporary.write_bytes(content)
    return facts


def facts_of(network: DetectorNetwork, told: Mapping[str, Any]) -> ModelFacts:
    """What a file of weights says of itself, but for recipe and licence.

    Args:
        told: what `load_network` gives beside the network.
    """
    options = told.get("options", {})
    return ModelFacts(
        classes=CLASSES,
        image_px=int(options.get("image_px", 640)),
        native=bool(options.get("native", False)),
        stride=SIDE_STEP,
        mask_px=network.architecture.mask_px if network.architecture.masks else 0,
        architecture=network.architecture.as_mapping(),
    )


def onnx_model(
    network: DetectorNetwork, facts: ModelFacts, *, limits: DetectLimits | None = None, half: bool = False
) -> Any:
    """A network on the processor, in `eval` mode, as an ONNX model.

    Args:
        limits: what is kept; confidence and overlap may be changed when it runs.

    Raises:
        PaveTwinError: a weight is not finite.
    """
    if not all(torch.isfinite(each).all() for each in network.state_dict().values()):
        raise PaveTwinError("The weights are not all finite numbers; export those of another run.")
    images = torch.zeros(2, 2 * SIDE_STEP, 3 * SIDE_STEP, 3, dtype=torch.uint8)
    steps = {name: SIDE_STEP * Dim(name, min=1, max=_LARGEST_STEPS) for name in ("down", "across")}
    encoder = _exported(
        _Encoder(network),
        images,
        {0: Dim("batch"), 1: steps["down"], 2: steps["across"]},
        ["images"],
        ["all_boxes", "scores", "maps"],
    )
    channels = network.neck.outputs[network.architecture.strides.index(REGION_STRIDE)]
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
