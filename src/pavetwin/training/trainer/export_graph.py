"""Parts of the exported model between and after the networks: suppression of duplicates, regions, and final outputs.

They are standard operators in ONNX's text form, for any number of images and detections, and follow `detect` in PyTorch
step by step: limits apply to an image, not to a class.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from onnx import TensorProto, helper, numpy_helper, parser

from pavetwin.labels.class_names import COARSE, ROAD_DEFECT, SUBTYPES

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
