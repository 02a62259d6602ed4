"""A twelve-metre city bus: low floor, doors on the right, air conditioning and hatches on the roof."""

from itertools import pairwise

import numpy as np

from assets.models.car_build import (
    CHROME,
    GLASS,
    LAMP_FRONT,
    LAMP_INDICATOR,
    LAMP_REAR,
    PLASTIC,
    PLATE,
    TRIM,
    skin_parts,
)
from assets.models.coachwork import Coach, CoachBody, box_outline
from assets.models.common import Model, Part, model, part
from assets.models.finish import fit, wheel_well
from assets.models.shapes import box, tube
from assets.models.simplify import simplify
from assets.models.wheels import lorry_wheel

WHEEL_M, FRONT_AXLE, REAR_AXLE = 0.48, 3.30, -2.60
SHAPE = Coach(
    rear_x=-6.0, front_x=6.0, half_m=1.25, floor_m=0.30, top_m=3.12, brow_m=1.20, lean=0.07, front_bow_m=0.22,
    rear_bow_m=0.08, tumblehome=0.025, corner_m=0.20, rail_m=0.26,
    arches=((FRONT_AXLE, WHEEL_M, 0.57), (REAR_AXLE, WHEEL_M, 0.57)),
)  # fmt: skip
POSTS = (4.55, 3.0, 1.55, 0.10, -1.35, -2.80, -4.25)
ON_ROOF = ((1.2, 3.5, 0.85), (-4.1, -1.3, 0.80), (4.3, 5.1, 0.36), (-0.8, 0.0, 0.36), (-5.5, -4.8, 0.7))
"""From x to x, and the half width: what stands on the roof."""
DOORS = ((4.75, 5.72), (0.20, 1.46), (-4.20, -3.15))


def half(doors: bool) -> list[Part]:
    """The left half, or with `doors` the right one (still at y ≥ 0)."""
    body = CoachBody(SHAPE, 4000)
    body.on_side(box_outline(-5.55, 5.62 if not doors else 4.70, 1.22, 2.62), TRIM, 0.10)
    edges = [-5.52, *reversed(POSTS), 5.58 if not doors else 4.66]
    panes = [(a + 0.03, b - 0.03) for a, b in pairwise(edges) if b - a > 0.3]
    body.panes_on_side(panes, 1.26, 2.58, GLASS)
    body.gaps_on_side(*(box_outline(x, x + 1.3, 0.0, 0.95) for x in (-5.5, -1.6, 1.6)), radius=0.03)
    body.on_side(box_outline(-5.6, -4.5, 0.65, 1.05), PLASTIC, 0.04)
    if doors:
        body.panes_on_side(DOORS, 0.36, 2.66, TRIM)
        leaves = [
            ((a + b) / 2.0 + side * 0.03, b - 0.05 if side > 0.0 else a + 0.05)
            for a, b in DOORS
            for side in (-1.0, 1.0)
        ]
        body.panes_on_side([(min(leaf), max(leaf)) for leaf in leaves], 0.50, 2.58, GLASS)
    simplify(body.skin, 0.004, 1.6)
    _front(body)
    _rear(body)
    body.covered_on_roof([box_outline(x0, x1, -0.3, y) for x0, x1, y in ON_ROOF])
    body.seams_on_roof((4.6, 3.1, 1.6, 0.1, -1.4, -2.9, -4.4))
    skin = body.opened()
    simplify(skin, 0.005, 1.6)
    return skin_parts(skin)


def _front(body: CoachBody) -> None:
    body.on_front([(-0.3, 1.02), (-0.3, 3.0), (1.14, 2.98, 0.2), (1.22, 2.3), (1.22, 1.06, 0.12)], TRIM, 0.05)
    body.on_front([(-0.3, 1.08), (-0.3, 2.62), (1.16, 2.62, 0.1), (1.17, 1.12, 0.1)], GLASS, 0.05)
    body.on_front(box_outline(-0.3, 0.85, 2.70, 2.92), GLASS, 0.03)
    body.on_front([(-0.3, 0.30), (-0.3, 0.46), (1.3, 0.46), (1.3, 0.30)], PLASTIC, 0.02)
    body.on_front([(0.72, 0.62), (0.72, 0.82), (1.14, 0.86), (1.16, 0.64)], LAMP_FRONT, 0.06, 0.015)
    body.on_front(box_outline(1.08, 1.16, 0.66, 0.84), LAMP_INDICATOR, 0.02)
    body.on_front(box_outline(-0.3, 0.26, 0.50, 0.61), PLATE, 0.005)
    body.on_front(box_outline(-0.1, 0.10, 0.80, 0.94), CHROME, 0.04)
    body.gaps_on_front([(-0.3, 0.98), (-0.3, 0.70), (0.62, 0.70), (0.66, 0.98)])


def _rear(body: CoachBody) -> None:
    body.on_rear([(-0.3, 1.80), (-0.3, 2.66), (0.98, 2.66), (1.04, 1.80)], GLASS, 0.10, 0.03)
    body.on_rear(box_outline(-0.3, 0.80, 0.72, 1.30), PLASTIC, 0.04)
    body.gaps_on_rear([(-0.3, 0.55), (-0.3, 1.68), (0.98, 1.68), (0.98, 0.55)])
    for low, label in ((0.72, LAMP_REAR), (0.93, LAMP_REAR), (1.14, LAMP_INDICATOR)):
        body.on_rear(box_outline(1.06, 1.19, low, low + 0.18), label, 0.03)
    body.on_rear(box_outline(-0.3, 0.26, 0.48, 0.59), PLATE, 0.005)
    body.on_rear([(-0.3, 0.30), (-0.3, 0.44), (1.3, 0.44), (1.3, 0.30)], PLASTIC, 0.02)


def roof() -> list[Part]:
    """Air conditioning with its fans, hatches, the cover of the gas or battery packs and a vent at the rear."""
    parts = [box("paint", (1.2, -0.85, 3.02), (3.5, 0.85, 3.40), 0.09)]
    for x in (1.75, 2.35, 2.95):
        for y in (-0.42, 0.42):
            angle = 2.0 * np.pi * np.arange(14) / 14
            for material, radius, z in (("trim", 0.23, 3.404), ("metal", 0.07, 3.407)):
                ring = np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle), np.full(14, z)], axis=1)
                parts.append(part(material, ring, [tuple(range(14))]))
    for x in (4.7, -0.4):
        parts.append(box("plastic", (x - 0.40, -0.36, 3.06), (x + 0.40, 0.36, 3.135), 0.02))
        parts.append(box("paint", (x - 0.36, -0.32, 3.10), (x + 0.36, 0.32, 3.175), 0.035))
    parts.append(box("paint", (-4.1, -0.80, 3.0), (-1.3, 0.80, 3.30), 0.10))
    parts += [box("trim", (x, -0.6, 3.2), (x + 0.02, 0.6, 3.304)) for x in (-3.4, -2.7, -2.0)]
    parts.append(box("plastic", (-5.5, -0.7, 3.02), (-4.8, 0.7, 3.14), 0.03))
    parts += [box("gap", (x, -0.62, 3.1), (x + 0.03, 0.62, 3.144)) for x in (-5.4, -5.3, -5.2, -5.1, -5.0, -4.9)]
    return parts


def mirror(side: float) -> list[Part]:
    """A mirror that hangs before the windscreen's upper corner, on an arm."""
    arm = [
        (5.75, side * 1.12, 2.90),
        (6.0 - 0.02, side * 1.28, 2.92),
        (5.98, side * 1.40, 2.75),
        (5.97, side * 1.40, 2.55),
    ]
    y = sorted((side * 1.30, side * 1.50))
    return [tube("trim", arm, 0.025, 6), box("trim", (5.90, y[0], 2.20), (5.99, y[1], 2.62), 0.03)]


@model("bus")
def bus() -> Model:
    """A city bus of twelve metres."""
    made = Model("bus")
    made.add(*half(doors=False), *(one.mirrored() for one in half(doors=True)), *roof(), *mirror(1.0), *mirror(-1.0))
    made.add(box("gap", (-5.6, -1.0, 0.34), (5.6, 1.0, 0.36)))
    for x, twin in ((FRONT_AXLE, False), (REAR_AXLE, True)):
        made.add_both_sides(
            *(one.moved((x, 1.20, WHEEL_M)) for one in lorry_wheel(WHEEL_M, 0.6 if twin else 0.3, twin))
        )
        made.add_both_sides(wheel_well(x, WHEEL_M, 0.57, 1.235, 0.72, 0.30))
    for side in (-1.0, 1.0):
        made.add(
            tube("trim", [(5.98, side * 0.1, 1.02), (5.99, side * 0.55, 1.12), (5.95, side * 0.98, 1.22)], 0.018, 5)
        )
    return fit(made)
