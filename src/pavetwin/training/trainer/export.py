"""Export of a network as one ONNX file: images in, boxes, classes, confidences and masks out.

PyTorch exports the encoder and the heads of regions. Suppression of duplicates, regions and final outputs between and
after them are standard operators in ONNX's text form, for any number of images and detections. They follow `detect` in
PyTorch step by step: limits apply to an image, not to a class.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
import torch
from onnx import TensorProto, compose, helper, numpy_helper, parser
from torch import Tensor, nn
from torch.export import Dim

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.labels.class_names import CLASS_LABELS, COARSE, ROAD_DEFECT, SUBTYPES
from pavetwin.perception.model_file import OUTPUTS, ModelFacts
from pavetwin.training.network.architecture import STRIDES, Architecture, variant
from pavetwin.training.network.network import REGION_STRIDE, DetectLimits, DetectorNetwork, RegionHead, gflops, pooled
from pavetwin.training.trainer.exported import exported_model, is_exported
from pavetwin.training.trainer.run_folder import BEST, SETTINGS, load_network

OPSET: Final = 18

_HEADER: Final = f'<ir_version: 10, opset_import: ["" : {OPSET}]>'


def suppression(
    channels: int, points: int, stride: int, *, confidence: float, overlap: float, candidates: int, most: int
) -> Any:
    """Model that drops duplicates and samples regions of defects. Boxes of one class in one image suppress each other.

    Args:
        channels: channels of the map from which regions are sampled.
        points: sampling points along each side of a region.
        stride: stride of that map, in pixels.
        confidence: default minimum score.
        overlap: default IoU above which the less confident box is dropped.
        candidates: maximum boxes of an image before duplicates are dropped.
        most: maximum boxes of an image afterwards.
    """
    return parser.parse_model(f"""
{_HEADER}
suppression (float[b, a, 4] all_boxes, float[b, a, {len(COARSE)}] scores, float[b, {channels}, r, c] maps,
             float[1] confidence, float[1] overlap)
    => (int64[n] image, float[n, 4] boxes, float[n] detection, int64[n] coarse, int64[d, 1] defects,
        float[d, {channels}, {points}, {points}] sampled)
    <float[1] confidence = {{{confidence}}}, float[1] overlap = {{{overlap}}}, float none = {{0.0}},
     float[1] all_above = {{0.0}}, int64[1] most = {{{most}}}, int64[1] candidates = {{{candidates}}},
     int64[2] rows_of_images = {{0, -1}}, int64[3] image_anchor_class = {{0, 2, 1}}, int64 first = {{0}},
     int64[1] second_axis = {{1}}, int64 kinds = {{{len(COARSE)}}}, int64 defect = {{{ROAD_DEFECT}}}>
{{
    shape = Shape (scores)
    nothing = ConstantOfShape (shape)
    flat = Reshape (scores, rows_of_images)
    flat_nothing = Reshape (nothing, rows_of_images)
    length = Shape <start = 1> (flat)
    is_likely = GreaterOrEqual (flat, confidence)
    likely = Where (is_likely, flat, none)
    candidate_count = Min (length, candidates)
    candidate_scores, candidate_places = TopK <axis = 1> (likely, candidate_count)
    flat_candidates = ScatterElements <axis = 1> (flat_nothing, candidate_places, candidate_scores)
    rowwise_candidates = Reshape (flat_candidates, shape)
    of_classes = Transpose <perm = [0, 2, 1]> (rowwise_candidates)
    chosen = NonMaxSuppression (all_boxes, of_classes, most, overlap, all_above)
    chosen_places = Gather <axis = 1> (chosen, image_anchor_class)
    chosen_scores = GatherND (scores, chosen_places)
    left = ScatterND (nothing, chosen_places, chosen_scores)
    flat_left = Reshape (left, rows_of_images)
    most_count = Min (length, most)
    best_scores, best_places = TopK <axis = 1> (flat_left, most_count)
    is_left = Greater (best_scores, none)
    found = NonZero (is_left)
    image = Gather <axis = 0> (found, first)
    rows = Transpose <perm = [1, 0]> (found)
    detection = GatherND (best_scores, rows)
    place = GatherND (best_places, rows)
    anchor = Div (place, kinds)
    coarse = Mod (place, kinds)
    image_column = Unsqueeze (image, second_axis)
    anchor_column = Unsqueeze (anchor, second_axis)
    box_places = Concat <axis = 1> (image_column, anchor_column)
    boxes = GatherND (all_boxes, box_places)
    is_defect = Equal (coarse, defect)
    where = NonZero (is_defect)
    defects = Transpose <perm = [1, 0]> (where)
    defect_boxes = GatherND (boxes, defects)
    defect_image = GatherND (image, defects)
    sampled = RoiAlign <output_height = {points}, output_width = {points}, sampling_ratio = 1, mode = "avg",
        spatial_scale = {1 / stride}, coordinate_transformation_mode = "half_pixel">
        (maps, defect_boxes, defect_image)
}}
""")


def answers(mask_px: int) -> Any:
    """Model of the final outputs; persons and cars get a subtype confidence of 1 and an empty mask."""
    masks = (
        f"""
    mask_side = Constant <value = int64[2] {{{mask_px}, {mask_px}}}> ()
    mask_shape = Concat <axis = 0> (count, mask_side)
    no_masks = ConstantOfShape (mask_shape)
    masks = ScatterND (no_masks, defects, of_masks)
"""
        if mask_px
        else ""
    )
    taken = f", float[d, {mask_px}, {mask_px}] of_masks" if mask_px else ""
    given = f", float[n, {mask_px}, {mask_px}] masks" if mask_px else ""
    return parser.parse_model(f"""
{_HEADER}
answers (int64[n] coarse, int64[d, 1] defects, float[d, {len(SUBTYPES)}] of_subtypes{taken})
    => (int64[n] classes, float[n] subtype{given})
    <int64[1] last = {{1}}, int64 shift = {{{len(SUBTYPES) - 1}}}, float sure = {{1.0}}>
{{
    count = Shape (coarse)
    ones = Expand (sure, count)
    best = ReduceMax <keepdims = 0> (of_subtypes, last)
    subtype = ScatterND (ones, defects, best)
    number = ArgMax <axis = 1, keepdims = 0> (of_subtypes)
    others = Add (coarse, shift)
    classes = ScatterND (others, defects, number)
    {masks}
}}
""")


def joined(parts: Sequence[Any], outputs: Sequence[str]) -> Any:
    """Join models, connecting outputs to inputs of the same name."""
    graphs = [part.graph for part in parts]
    given = {value.name: value for graph in graphs for value in graph.output}
    graph = helper.make_graph(
        [_plain(node) for graph in graphs for node in graph.node],
        "detector",
        [value for graph in graphs for value in graph.input if value.name not in given],
        [given[name] for name in outputs],
        [weight for graph in graphs for weight in graph.initializer],
    )
    version = [helper.make_opsetid("", OPSET)]
    return helper.make_model(graph, opset_imports=version, ir_version=parts[0].ir_version, producer_name="PaveTwin")


def _plain(node: Any) -> Any:
    """Remove the exporter's metadata from a node, which names files of the machine."""
    del node.metadata_props[:]
    node.doc_string = ""
    return node


def store_in_half(model: Any) -> None:
    """Store weights as float16, each with a cast to float32, which runs once when the file is opened."""
    casts = []
    for weight in model.graph.initializer:
        if weight.data_type != TensorProto.FLOAT or np.prod(weight.dims) < 64:
            continue
        name = weight.name
        weight.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(weight).astype(np.float16), f"{name}/half"))
        casts.append(helper.make_node("Cast", [weight.name], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)


SIDE_STEP: Final = 32  # Sides of images are multiples of this length, in pixels
_LARGEST_STEPS: Final = 512  # Longest side of an image, in steps


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
