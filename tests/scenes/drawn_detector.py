"""A detector of flat rectangles whose network is written by hand: exact, and a file of a few kilobytes.

Its file has the inputs, outputs and properties of an exported one, and the same suppression, regions and answers. It
finds rectangles of the colours of `COLOURS`, of 20 to 180 px, and takes their edges to the pixel.
"""

from pathlib import Path

from PIL import Image, ImageDraw

from pavetwin.labels.boxes import PixelBox

FILE = Path(__file__).parents[1] / "perception" / "rectangles.onnx"
"""Written where `onnx` is installed: `PYTHONPATH=src:tests python -m scenes.drawn_detector`."""

SIDE_PX = 96
"""Side of the images that its file names as training images."""

ROAD = (120, 120, 120)

COLOURS = {
    "single_crack": (20, 20, 20),
    "crocodile_crack": (50, 50, 50),
    "pothole": (80, 80, 80),
    "person": (230, 60, 40),
    "car": (40, 80, 220),
}

REACH_PX = 192
"""How far its edges are looked for from within an object."""


def drawn(size: tuple[int, int], *things: tuple[str, PixelBox]) -> Image.Image:
    """A picture (width, height) of a road with things on it: name and box, right and bottom exclusive."""
    picture = Image.new("RGB", size, ROAD)
    pen = ImageDraw.Draw(picture)
    for name, (left, top, right, bottom) in things:
        pen.rectangle([left, top, right - 1, bottom - 1], fill=COLOURS[name])
    return picture


ENCODER = f"""
<ir_version: 10, opset_import: ["" : 18]>
encoder (uint8[batch, down, across, 3] images)
    => (float[batch, a, 4] all_boxes, float[batch, a, 3] scores, float[batch, 2, r, c] maps)
    <int64[1] channel = {{1}}, int64[1] last = {{-1}}, int64[1] start = {{4}}, int64[1] step = {{8}},
     int64[1] end = {{100000}}, int64[1] x_axis = {{3}}, int64[1] y_axis = {{2}},
     int64 x_at = {{3}}, int64 y_at = {{2}}, float dark = {{0.36}}, float apart = {{0.3}}, float full = {{255.0}},
     float zero = {{0.0}}, float one = {{1.0}},
     float far = {{-1000000.0}}, float first = {{0.0}}, float most = {{0.9}}, int64[2] column = {{-1, 1}},
     int64[4] cells = {{0, 3, -1, 1}}, int64[3] rows = {{0, -1, 3}}, int64[3] boxes_shape = {{0, -1, 4}}>
{{
    values = Cast <to = 1> (images)
    shares = Div (values, full)
    planes = Transpose <perm = [0, 3, 1, 2]> (shares)
    red, green, blue = Split <axis = 1, num_outputs = 3> (planes)
    light = Max (red, green, blue)
    is_dark = Less (light, dark)
    redness = Sub (red, blue)
    is_red = Greater (redness, apart)
    blueness = Sub (blue, red)
    is_blue = Greater (blueness, apart)
    inside = Concat <axis = 1> (is_dark, is_red, is_blue)
    covered = Cast <to = 1> (inside)
    shape = Shape (covered)
    width_i = Gather (shape, x_at)
    height_i = Gather (shape, y_at)
    width = Cast <to = 1> (width_i)
    height = Cast <to = 1> (height_i)
    x = Range (first, width, one)
    y_flat = Range (first, height, one)
    y = Reshape (y_flat, column)
    x_next = Add (x, one)
    y_next = Add (y, one)
    x_minus = Neg (x)
    y_minus = Neg (y)
    to_left = Where (inside, zero, x_next)
    to_top = Where (inside, zero, y_next)
    to_right = Where (inside, far, x_minus)
    to_bottom = Where (inside, far, y_minus)
    left = MaxPool <kernel_shape = [1, {REACH_PX}], pads = [0, {REACH_PX - 1}, 0, 0]> (to_left)
    top = MaxPool <kernel_shape = [{REACH_PX}, 1], pads = [{REACH_PX - 1}, 0, 0, 0]> (to_top)
    right_minus = MaxPool <kernel_shape = [1, {REACH_PX}], pads = [0, 0, 0, {REACH_PX - 1}]> (to_right)
    bottom_minus = MaxPool <kernel_shape = [{REACH_PX}, 1], pads = [0, 0, {REACH_PX - 1}, 0]> (to_bottom)
    right_far = Neg (right_minus)
    bottom_far = Neg (bottom_minus)
    right = Min (right_far, width)
    bottom = Min (bottom_far, height)
    x_full = Expand (x, shape)
    y_full = Expand (y, shape)
    all_sides = Concat <axis = 1> (left, top, right, bottom, x_full, y_full, covered)
    some_rows = Slice (all_sides, start, end, y_axis, step)
    some = Slice (some_rows, start, end, x_axis, step)
    l4, t4, r4, b4, x4, y4, c4 = Split <axis = 1, num_outputs = 7> (some)
    l = Reshape (l4, cells)
    t = Reshape (t4, cells)
    r = Reshape (r4, cells)
    b = Reshape (b4, cells)
    px = Reshape (x4, cells)
    py = Reshape (y4, cells)
    is_in = Reshape (c4, cells)
    sides = Concat <axis = 3> (l, t, r, b)
    all_boxes = Reshape (sides, boxes_shape)
    before = Sub (px, l)
    before_one = Add (before, one)
    after = Sub (r, px)
    above = Sub (py, t)
    above_one = Add (above, one)
    below = Sub (b, py)
    x_short = Min (before_one, after)
    x_long = Max (before_one, after)
    y_short = Min (above_one, below)
    y_long = Max (above_one, below)
    x_share = Div (x_short, x_long)
    y_share = Div (y_short, y_long)
    both = Mul (x_share, y_share)
    root = Sqrt (both)
    scaled = Mul (root, most)
    certain = Mul (scaled, is_in)
    apart_by_class = Constant <value = float[1, 3, 1, 3] {{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}}> ()
    by_class = Mul (certain, apart_by_class)
    scores = Reshape (by_class, rows)
    dark_part = Cast <to = 1> (is_dark)
    of_regions = Concat <axis = 1> (light, dark_part)
    maps = AveragePool <kernel_shape = [8, 8], strides = [8, 8]> (of_regions)
}}
"""
"""The edges of what is around each eighth pixel, by the nearest road to its four sides; surest in the middle."""

REGIONS = """
<ir_version: 10, opset_import: ["" : 18]>
regions (float[n, 2, 14, 14] sampled) => (float[n, 3] of_subtypes, float[n, 14, 14] of_masks)
    <int64[2] from = {5, 5}, int64[2] until = {9, 9}, int64[2] sides = {2, 3}, int64[1] channel = {1},
     float slope = {15.0}, float[3] tones = {0.0784, 0.1961, 0.3137}>
{
    tone, region_masks = Split <axis = 1, num_outputs = 2> (sampled)
    of_masks = Squeeze (region_masks, channel)
    middle = Slice (tone, from, until, sides)
    mean = ReduceMean <keepdims = 0> (middle, sides)
    away = Sub (mean, tones)
    steep = Mul (away, slope)
    squared = Mul (steep, steep)
    logits = Neg (squared)
    of_subtypes = Softmax <axis = 1> (logits)
}
"""
"""The subtype by the tone of the middle, and the mask by what is dark."""


def make() -> None:
    """Write `FILE`."""
    import onnx
    from onnx import compose, helper, parser

    from pavetwin.perception.model_file import OUTPUTS, ModelFacts
    from pavetwin.training.trainer.export import answers, joined, suppression

    between = suppression(2, 14, 8, confidence=0.25, overlap=0.7, candidates=3000, most=300)
    encoder, regions = (
        compose.add_prefix(parser.parse_model(text), name, rename_inputs=False, rename_outputs=False)
        for name, text in (("encoder/", ENCODER), ("regions/", REGIONS))
    )
    model = joined([encoder, between, regions, answers(14)], OUTPUTS)
    facts = ModelFacts(image_px=SIDE_PX, native=True, mask_px=14, licence="Apache-2.0")
    helper.set_model_props(model, facts.as_properties())
    onnx.checker.check_model(model, full_check=True)
    FILE.write_bytes(model.SerializeToString())


if __name__ == "__main__":
    make()
