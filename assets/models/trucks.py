"""Two trucks: a delivery truck with a bonnet and a box, and a three-axle truck with its cab over the engine."""

import numpy as np

from assets.models.car_build import (
    CHROME,
    GLASS,
    LAMP_FRONT,
    LAMP_INDICATOR,
    PLASTIC,
    PLATE,
    TRIM,
    CarBody,
    CarDetails,
    skin_parts,
)  # fmt: skip
from assets.models.car_parts import arch_liner, mirror, wipers
from assets.models.car_shape import CarShape
from assets.models.coachwork import Coach, CoachBody, box_outline
from assets.models.common import Model, Part, model, part
from assets.models.finish import fit, wheel_well
from assets.models.implicit import on_surface
from assets.models.shapes import bordered, box, loft, rounded_rectangle, tube
from assets.models.simplify import simplify
from assets.models.wheels import lorry_wheel


def cargo_box(x0: float, x1: float, half: float, z0: float, z1: float, ribs: float) -> list[Part]:
    """A cargo box: coloured sides in a light frame, a roof with seams every `ribs` metres, doors at the rear."""
    length, breadth, high = x1 - x0, 2.0 * half, z1 - z0 - 0.01
    parts = [
        bordered("box", (x0 + 0.08, 0.1 - half, z1 - 0.01), (length - 0.16, 0.0, 0.0), (0.0, breadth - 0.2, 0.0), 0.16),
        bordered("paint", (x1, half, z0), (-length, 0.0, 0.0), (0.0, 0.0, high), 0.20),
        bordered("paint", (x0, -half, z0), (length, 0.0, 0.0), (0.0, 0.0, high), 0.20),
        bordered("paint", (x1, -half, z0), (0.0, breadth, 0.0), (0.0, 0.0, high), 0.20),
        bordered("box", (x0, half, z0), (0.0, -breadth, 0.0), (0.0, 0.0, high), 0.12),
        part("gap", [(x0, -half, z0), (x0, half, z0), (x1, half, z0), (x1, -half, z0)], [(0, 1, 2, 3)]),
    ]
    across = [(x, 0.02, z1 - 0.03, z1 + 0.004, "box", 0.85) for x in np.arange(x0 + ribs, x1 - 0.3, ribs)]
    across += [(x, 0.045, z1 - 0.08, z1, "metal", 1.0) for x in (x0 + 0.04, x1 - 0.04)]
    parts += [
        box(name, (x - wide, 0.105 - half, low), (x + wide, half - 0.105, top), tint=tint)
        for x, wide, low, top, name, tint in across
    ]
    back = x0 - 0.006
    for side in (-1.0, 1.0):
        y, out = side * (half - 0.05), side * half
        parts += [
            box("metal", (x0 - 0.005, y - 0.054, z1 - 0.09), (x1 + 0.005, y + 0.054, z1), 0.012),
            box("metal", (x0 - 0.005, y - 0.054, z0 - 0.005), (x1 + 0.005, y + 0.054, z0 + 0.11)),
            box(
                "lamp_rear",
                (back - 0.008, y - 0.10 * side - 0.06, z1 - 0.075),
                (x0, y - 0.10 * side + 0.06, z1 - 0.035),
            ),
            *(
                tube(
                    "metal", [(back - 0.012, share * out, z0 + 0.08), (back - 0.012, share * out, z1 - 0.08)], 0.016, 6
                )
                for share in (0.2, 0.55)
            ),
        ]
    parts.append(box("gap", (back - 0.002, -0.008, z0 + 0.1), (x0, 0.008, z1 - 0.1)))
    return parts


def chassis(x0: float, x1: float, z: float, half: float) -> list[Part]:
    """Two beams, a bumper with lamps and plate at the rear, guards along the sides."""
    parts = [box("trim", (x0 + 0.1, y - 0.05, z - 0.2), (x1, y + 0.05, z)) for y in (-0.4, 0.4)]
    parts.append(box("trim", (x0 + 0.02, -half + 0.04, z - 0.36), (x0 + 0.12, half - 0.04, z - 0.22), 0.015))
    for y in (-half + 0.24, half - 0.24):
        parts.append(box("lamp_rear", (x0 + 0.005, y - 0.17, z - 0.34), (x0 + 0.03, y + 0.07, z - 0.24)))
        parts.append(box("lamp_indicator", (x0 + 0.005, y + 0.07, z - 0.34), (x0 + 0.03, y + 0.15, z - 0.24)))
    parts.append(box("plate", (x0 + 0.008, -0.26, z - 0.345), (x0 + 0.03, 0.26, z - 0.235)))
    return parts


def axle_pair(x: float, radius: float, half: float, twin: bool) -> list[Part]:
    """The two wheels of an axle; twins are one wide wheel with a deep rim."""
    left = [one.moved((x, half, radius)) for one in lorry_wheel(radius, 0.52 if twin else 0.28, twin)]
    return left + [one.mirrored() for one in left]


def mudguard(x: float, radius: float, half: float, width: float) -> list[Part]:
    """A guard over a rear wheel, on both sides."""
    angle = np.linspace(0.25, np.pi - 0.25, 9)
    along, z = x + (radius + 0.07) * np.cos(angle), radius + (radius + 0.07) * np.sin(angle)
    rings = [np.stack([along, np.full(9, y), z], axis=1) for y in (half, half - width)]
    left = loft("plastic", rings, closed=False)
    return [left, left.mirrored()]


def fairing(x0: float, x1: float, half: float, z0: float, z1: float) -> Part:
    """The wind deflector on a cab's roof, rising from x1 to the box at x0."""
    rings = []
    for share in np.linspace(0.0, 1.0, 6):
        x, top = x1 + (x0 - x1) * share, z0 + 0.04 + (z1 - z0 - 0.04) * np.sin(0.5 * np.pi * share) ** 0.9
        w, r = half * (0.80 + 0.20 * share), 0.5 * (top - z0) + 0.02
        outline = rounded_rectangle(w, 0.5 * (top - z0 + 0.1), min(r, 0.16), 3)
        rings.append(
            np.column_stack([np.full(len(outline), x), outline[:, 0], outline[:, 1] + 0.5 * (top + z0 - 0.1)])[::-1]
        )
    return loft("paint", rings, 50.0, caps=True)


@model("light_truck")
def light_truck() -> Model:
    """A delivery truck of 6.5 m: the front of a large van, and a box wider and higher than it."""
    shape = CarShape(
        deck=((0.6, 1.26), (1.9, 1.25), (2.25, 1.23), (2.6, 1.15), (2.95, 1.04), (3.15, 0.92), (3.25, 0.78)),
        plan=((0.6, 0.985), (1.5, 0.995), (2.3, 0.985), (2.8, 0.96), (3.25, 0.90)),
        nose=((0.18, 3.08), (0.28, 3.19), (0.5, 3.25), (0.75, 3.24), (0.95, 3.16), (1.08, 2.98)),
        tail=((0.25, 1.0), (1.2, 1.0)),
        roof=((0.5, 2.33), (1.2, 2.33), (1.6, 2.29), (1.9, 2.20)),
        cabin=((0.5, 0.92), (1.2, 0.925), (1.8, 0.915), (2.4, 0.85)),
        windscreen=((2.46, 1.20), (1.72, 2.16)), backlight=((0.985, 1.15), (1.0, 2.3)),
        belt_m=1.18, axles=(2.28, -30.0), wheel_m=0.345, arch_m=0.395, sill_m=0.26, nose_bow_m=0.32, tail_bow_m=0.0,
        glass_bow=0.22, tumblehome=0.13, rail_m=0.14, roof_crown=0.05, crown_m=0.07,
        section=((0.2, 0.06), (0.34, 0.015), (0.55, 0.0), (0.95, 0.005), (1.25, 0.035)),
        crease=((-2.0, 1.08), (3.0, 1.02)), dome=(0.014, 0.55),
    )  # fmt: skip
    details = CarDetails(
        doors=[[(2.02, 0.36), (1.84, 0.70, 0.15), (2.12, 1.05), (2.08, 2.0), (1.06, 2.0), (1.06, 0.36)]],
        pillars=[((1.80, 1.2), (1.62, 1.9), 0.025)], quarter=((1.12, 1.2), (1.12, 2.1)),
        headlamp=[(0.56, 0.84), (0.60, 0.98), (1.1, 1.12), (1.1, 0.90)], headlamp_reach_m=0.46,
        tail_lamp=[(5.0, 5.0), (5.0, 5.1), (5.1, 5.1), (5.1, 5.0)],
        front=[([(-0.3, 0.66), (-0.3, 0.94), (0.50, 0.94), (0.44, 0.66)], PLASTIC), ([(-0.3, 0.77), (-0.3, 0.83),
               (0.46, 0.83), (0.46, 0.77)], CHROME),
               ([(-0.3, 0.2), (-0.3, 0.48), (1.2, 0.48), (1.2, 0.2)], PLASTIC), ([(-0.3, 0.52), (-0.3, 0.63),
               (0.26, 0.63), (0.26, 0.52)], PLATE)],
        rear=[], bonnet_front=(3.08, 0.36), bonnet_inset_m=0.10,
    )  # fmt: skip
    skin = CarBody(shape, details, 2800).drawn()
    simplify(skin, 0.0018)
    made = Model("light_truck")
    made.add_both_sides(*skin_parts(skin), arch_liner(shape, 2.28), *mirror(1.98, 0.98, 1.26, 1.7, "plastic"))
    made.add(
        *wipers(shape.field, 1.20, 2.46, 0.62),
        *axle_pair(2.28, 0.345, 0.965, False),
        *axle_pair(-1.55, 0.345, 1.0, True),
    )
    made.add(
        *cargo_box(-3.24, 0.92, 1.08, 0.82, 2.85, 0.62),
        *chassis(-3.24, 2.4, 0.80, 1.06),
        *mudguard(-1.55, 0.345, 1.04, 0.5),
    )
    made.add(fairing(0.95, 1.65, 0.92, 2.24, 2.78), box("gap", (1.0, -0.7, 0.30), (2.9, 0.7, 0.32)))
    for y in (-1.02, 1.02):
        made.add(*(box("metal", (-0.9, y - 0.02, z), (0.7, y + 0.02, z + 0.09)) for z in (0.42, 0.60)))
    return fit(made)


CAB = Coach(
    rear_x=2.75, front_x=4.60, half_m=1.20, floor_m=0.45, top_m=3.05, brow_m=1.55, lean=0.13, front_bow_m=0.22,
    rear_bow_m=0.0,
    tumblehome=0.045, corner_m=0.20, rail_m=0.26, crown=0.05, arches=((3.35, 0.50, 0.60),),
)  # fmt: skip


def heavy_cab() -> list[Part]:
    """The left half of the cab over the engine."""
    body = CoachBody(CAB, 3600, 0.05)
    body.on_front([(-0.3, 1.72), (-0.3, 2.72), (1.00, 2.70, 0.12), (1.10, 1.78, 0.12)], TRIM, 0.05)
    body.on_front([(-0.3, 1.76), (-0.3, 2.67), (0.96, 2.65, 0.10), (1.06, 1.82, 0.10)], GLASS, 0.05)
    body.on_front([(-0.3, 1.02), (-0.3, 1.56), (0.80, 1.56), (0.72, 1.02)], PLASTIC, 0.05)
    for z in (1.12, 1.26, 1.40):
        body.on_front(box_outline(-0.3, 0.70, z, z + 0.05), TRIM, 0.01)
    body.on_front(box_outline(-0.12, 0.12, 1.60, 1.68), CHROME, 0.02)
    body.on_front([(-0.3, 0.4), (-0.3, 0.96), (1.3, 0.96), (1.3, 0.4)], PLASTIC, 0.02)
    body.on_front([(0.72, 0.70), (0.72, 0.88), (1.12, 0.90), (1.12, 0.70)], LAMP_FRONT, 0.05, 0.015)
    body.on_front(box_outline(1.05, 1.12, 0.72, 0.88), LAMP_INDICATOR, 0.02)
    body.on_front(box_outline(-0.3, 0.26, 0.62, 0.73), PLATE, 0.005)
    body.on_side([(3.16, 1.72), (3.16, 2.58), (3.95, 2.58, 0.1), (4.22, 1.66, 0.08), (3.9, 1.60)], TRIM, 0.08)
    body.on_side([(3.19, 1.75), (3.19, 2.55), (3.93, 2.55, 0.1), (4.18, 1.69, 0.08), (3.9, 1.63)], GLASS, 0.08)
    body.gaps_on_side([(3.10, 1.12), (3.10, 2.68), (4.0, 2.68), (4.30, 1.64), (4.26, 1.12), (3.9, 1.12)], radius=0.06)
    body.on_side(box_outline(2.5, 5.0, 0.3, 0.62), PLASTIC, 0.02)
    skin = body.opened()
    simplify(skin, 0.002, 1.0)
    return skin_parts(skin)


@model("heavy_truck")
def heavy_truck() -> Model:
    """A three-axle truck of 9.2 m with a cargo box and a cooling unit over the cab."""
    made = Model("heavy_truck")
    made.add_both_sides(*heavy_cab(), wheel_well(3.35, 0.50, 0.60, 1.19, 0.70, 0.45))
    for x, y, twin in ((3.35, 1.16, False), (-1.55, 1.20, True), (-2.90, 1.20, True)):
        made.add(*axle_pair(x, 0.50, y, twin))
        if twin:
            made.add(*mudguard(x, 0.50, 1.20, 0.55))
    made.add(*cargo_box(-4.59, 2.45, 1.215, 1.15, 3.74, 0.78), *chassis(-4.59, 3.0, 1.12, 1.16))
    made.add(
        box("box", (2.45, -0.85, 2.55), (2.80, 0.85, 3.60), 0.08), box("trim", (2.79, -0.62, 2.95), (2.81, 0.62, 3.40))
    )
    made.add(fairing(2.85, 4.0, 1.05, 2.98, 3.5))
    made.add(
        box("plastic", (3.25, -0.34, 3.0), (3.9, 0.34, 3.06), 0.02), box("gap", (2.8, -0.9, 0.5), (4.3, 0.9, 0.52))
    )
    blade = np.array([[4.7, 0.02 + 0.9 * t, 1.76 + 0.05 * t] for t in np.linspace(0.0, 1.0, 5)])
    made.add_both_sides(
        tube("trim", [(4.1, 1.15, 2.62), (4.25, 1.32, 2.64), (4.25, 1.34, 2.45)], 0.022, 6),
        box("plastic", (4.18, 1.24, 1.90), (4.30, 1.46, 2.52), 0.035),
        box("chrome", (4.172, 1.27, 1.95), (4.181, 1.43, 2.47), tint=0.5),
        box("metal", (0.6, 0.80, 0.55), (1.9, 1.18, 1.05), 0.10),
        box("metal", (-0.9, 1.16, 0.55), (0.5, 1.20, 0.65)),
        box("metal", (-0.9, 1.16, 0.80), (0.5, 1.20, 0.90)),
        tube("trim", on_surface(CAB.field, blade, 8) + (0.02, 0.0, 0.0), 0.012, 4),
    )
    made.add(part("gap", [(2.0, -1.0, 0.9), (2.8, -1.0, 0.9), (2.8, 1.0, 0.9), (2.0, 1.0, 0.9)], [(0, 1, 2, 3)]))
    return fit(made)
