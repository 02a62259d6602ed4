"""Plates of traffic signs, without their posts: in the plane x = 0, looking along x, middle at the origin.

Sizes are the usual ones of town streets (Vienna Convention on Road Signs and Signals, 1968, shapes B1, B2, C14). What
is on a plate is geometry: fields a fraction of a millimetre over each other would flicker, so each lies 2 mm above the
last.
"""

from collections.abc import Sequence

import numpy as np

from assets.models.common import Floats, Model, Part, model, part

PLATE_M = 0.003
LAYER_M = 0.002


def _regular(corners: int, radius: float, first_deg: float, rounding: float = 0.0, steps: int = 4) -> Floats:
    """A regular outline (n, 2) in y and z, counter-clockwise seen from +x, corners rounded by a radius."""
    points = []
    turn = 2.0 * np.pi / corners
    for k in range(corners):
        angle = np.radians(first_deg) + k * turn
        if rounding == 0.0:
            points.append((radius * np.cos(angle), radius * np.sin(angle)))
            continue
        middle = (radius - rounding / np.cos(turn / 2.0)) * np.array([np.cos(angle), np.sin(angle)])
        bend = angle + np.linspace(-turn / 2.0, turn / 2.0, steps)
        points += [tuple(middle + rounding * np.array([np.cos(t), np.sin(t)])) for t in bend]
    return np.array(points)


def _field(material: str, outline: Floats, layer: int) -> Part:
    """A flat field that looks along x."""
    x = PLATE_M + LAYER_M * layer
    return part(material, np.column_stack([np.full(len(outline), x), outline]), [tuple(range(len(outline)))])


def _plate(material: str, outline: Floats) -> list[Part]:
    """The plate itself: its face in a colour, back and edge bare."""
    n = len(outline)
    back = np.column_stack([np.zeros(n), outline])
    front = np.column_stack([np.full(n, PLATE_M), outline])
    edge = part("mast", np.concatenate([back, front]), [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)])
    behind = part("mast", back, [tuple(range(n - 1, -1, -1))])
    return [edge, behind, _field(material, outline, 0)]


def _clamps(reach_z: float) -> list[Part]:
    """Two rails behind the plate, by which it hangs on its post."""
    rails = []
    for z in (-reach_z, reach_z):
        y, d, h = 0.16, 0.022, 0.015
        corners = np.array([(-d, -y, z - h), (-d, y, z - h), (-d, y, z + h), (-d, -y, z + h)])
        front = corners * (0.0, 1.0, 1.0)
        faces = [(3, 2, 1, 0), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
        rails.append(part("mast", np.concatenate([corners, front]), faces))
    return rails


def stroke(material: str, line: Sequence[tuple[float, float]] | Floats, width: float, layer: int) -> Part:
    """A painted line of a width through points in y and z, mitred."""
    points = np.asarray(line, dtype=np.float64)
    along = np.gradient(points, axis=0)
    legs = np.diff(points, axis=0)
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    along = np.concatenate([legs[:1], legs[:-1] + legs[1:], legs[-1:]])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    cosines = np.concatenate([[1.0], np.sum(along[1:-1] * legs[:-1], axis=1), [1.0]])
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) * (width / 2.0 / np.maximum(cosines, 0.5))[:, None]
    n = len(points)
    flat = np.concatenate([points - across, points + across])
    x = np.full(2 * n, PLATE_M + LAYER_M * layer)
    return part(material, np.column_stack([x, flat]), [(i, i + 1, n + i + 1, n + i) for i in range(n - 1)])


def _arc(
    y: float, z: float, ry: float, rz: float, first_deg: float, last_deg: float, steps: int = 9
) -> list[tuple[float, float]]:
    """Points on an arc. Who looks at a sign sees y grow to the right."""
    turn = np.radians(np.linspace(first_deg, last_deg, steps))
    return [(float(y + ry * np.cos(t)), float(z + rz * np.sin(t))) for t in turn]


@model("sign_round")
def sign_round() -> Model:
    """A speed limit of 30, 0.60 m across."""
    made = Model("sign_round")
    made.add(*_plate("sign_white", _regular(28, 0.300, 0.0)), *_clamps(0.12))
    made.add(_field("sign_red", _regular(28, 0.292, 0.0), 1), _field("sign_white", _regular(28, 0.225, 0.0), 2))
    three = _arc(-0.068, 0.048, 0.046, 0.047, 150.0, -80.0) + _arc(-0.068, -0.048, 0.050, 0.050, 80.0, -150.0)
    nought = _arc(0.068, 0.0, 0.048, 0.098, 90.0, 450.0, 17)
    made.add(stroke("sign_black", three, 0.030, 3), stroke("sign_black", nought, 0.030, 3))
    return made


@model("sign_triangle")
def sign_triangle() -> Model:
    """Give way, sides of 0.90 m, point down."""
    made = Model("sign_triangle")
    radius = 0.90 / np.sqrt(3.0)
    made.add(*_plate("sign_white", _regular(3, radius, -90.0, 0.04)))
    made.add(_field("sign_red", _regular(3, radius - 0.016, -90.0, 0.034), 1))
    made.add(_field("sign_white", _regular(3, radius - 0.20, -90.0, 0.012), 2))
    made.add(*[rail.moved((0.0, 0.0, 0.06)) for rail in _clamps(0.08)])
    return made


@model("sign_octagon")
def sign_octagon() -> Model:
    """Stop, 0.75 m across the flats."""
    made = Model("sign_octagon")
    radius = 0.375 / np.cos(np.pi / 8.0)
    made.add(*_plate("sign_white", _regular(8, radius, 22.5)), *_clamps(0.14))
    made.add(_field("sign_red", _regular(8, radius - 0.022, 22.5), 1))
    half, wide = 0.115, 0.055
    lines = [
        _arc(-0.225, 0.056, wide, 0.058, 25.0, 270.0)[:-1] + _arc(-0.225, -0.056, wide, 0.058, 90.0, -155.0),
        [(-0.075 - wide, half), (-0.075 + wide, half)],
        [(-0.075, half), (-0.075, -half)],
        _arc(0.075, 0.0, wide, half, 90.0, 450.0, 15),
        [(0.18, -half), (0.18, half), *_arc(0.225, 0.06, wide, 0.055, 90.0, -90.0, 7), (0.18, 0.005)],
    ]  # fmt: skip
    made.add(*[stroke("sign_white", line, 0.032, 2) for line in lines])
    return made
