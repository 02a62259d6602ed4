"""What is fixed to a car's body: mirrors, wipers, handles, aerial, roof rails, the inside of the wheel arches."""

import numpy as np

from assets.models.car_shape import CarShape
from assets.models.common import Floats, Part, part
from assets.models.implicit import Field, on_surface
from assets.models.shapes import loft, rounded_rectangle, tube


def arch_liner(shape: CarShape, axle: float) -> Part:
    """The inside of a wheel arch: a dark half pipe from the body's edge inwards, and its end."""
    angle = np.linspace(-0.30, np.pi + 0.30, 21)
    x, z = axle + shape.arch_m * np.cos(angle), shape.wheel_m + shape.arch_m * np.sin(angle)
    outer = np.stack([x, np.zeros_like(x), z], axis=1)
    outer[:, 1] = shape.half_at(outer) - 0.004
    inner = np.stack([x, np.full_like(x, shape.half_width - 0.32), z], axis=1)
    n = len(angle)
    faces: list[tuple[int, ...]] = [(i, i + 1, n + i + 1, n + i) for i in range(n - 1)]
    faces.append(tuple(range(2 * n - 1, n - 1, -1)))
    return part("gap", np.concatenate([outer, inner]), faces)


def underbody(shape: CarShape) -> Part:
    """A dark floor, so that no light comes through the body from below."""
    x0, x1 = min(x for _, x in shape.tail) + 0.25, max(x for _, x in shape.nose) - 0.25
    y, z = shape.half_width - 0.30, shape.sill_m + 0.03
    return part("gap", [(x0, -y, z), (x1, -y, z), (x1, y, z), (x0, y, z)], [(0, 3, 2, 1)])


def mirror(x: float, y: float, z: float, size: float = 1.0, material: str = "paint") -> list[Part]:
    """A door mirror on the left side with its foot at (x, y, z), its glass looking back."""
    rings = []
    stations = (-0.02, 0.5, 0.55, 0.02), (0.03, 0.9, 0.9, 0.0), (0.13, 1.0, 1.0, -0.02), (0.19, 0.7, 0.8, -0.05)
    for across, deep, high, lean in stations:
        outline = size * rounded_rectangle(0.055 * deep, 0.072 * high, 0.04 * deep, 2)
        ring = np.column_stack([outline[:, 0] + size * lean, np.full(len(outline), size * across), outline[:, 1]])
        rings.append(ring[::-1] + (x, y, z + 0.07 * size))
    glass = size * np.array(
        [(-0.060, 0.02, -0.05), (-0.082, 0.165, -0.05), (-0.082, 0.165, 0.05), (-0.060, 0.02, 0.05)]
    )
    foot = tube("trim", [(x + 0.05, y - 0.10, z), (x + 0.02, y + 0.05, z + 0.02)], 0.025 * size, 5)
    return [
        loft(material, rings, 60.0, caps=True),
        part("chrome", glass + (x, y, z + 0.07 * size), [(0, 3, 2, 1)], tint=0.5),
        foot,
    ]


def wipers(field: Field, foot: float, x: float, half: float) -> list[Part]:
    """Two parked wipers at the foot of the windscreen, arms from the cowl; `foot` is the height they lie at."""
    out = []
    for start, end in ((0.92 * half, -0.02 * half), (0.02 * half, -0.88 * half)):
        y = np.linspace(start, end, 7)
        blade = np.stack([np.full(7, x), y, np.linspace(foot + 0.055, foot + 0.085, 7)], axis=1)
        out.append(tube("trim", on_surface(field, blade, 8) + (0.010, 0.0, 0.014), 0.009, 4))
        pivot = np.array([x + 0.04, start - 0.10 * half, foot])
        middle = blade[3] + (0.02, 0.0, 0.012)
        out.append(
            tube(
                "trim",
                on_surface(field, np.stack([pivot, (pivot + middle) / 2.0, middle]), 8) + (0.014, 0.0, 0.02),
                0.010,
                4,
            )
        )
    return out


def handle(shape: CarShape, x: float, z: float, material: str = "paint") -> Part:
    """A door handle with its middle at x, on the left side."""
    spots = np.array([(x - 0.09, 0.0, z), (x - 0.05, 0.0, z), (x + 0.05, 0.0, z), (x + 0.09, 0.0, z)])
    spots[:, 1] = shape.half_width
    for _ in range(20):
        spots[:, 1] -= shape.field(spots)
    spots[:, 1] += np.array([-0.005, 0.016, 0.016, -0.005])
    return tube(material, spots, [0.012, 0.013, 0.013, 0.012], 6)


def aerial(shape: CarShape, x: float) -> Part:
    """A fin on the roof's rear end."""
    z = float(on_surface(shape.field, np.array([[x, 0.0, shape.roof[0][1] + 0.05]]))[0, 2])
    rings = []
    for high, length, wide, back in ((-0.02, 0.17, 0.05, 0.0), (0.02, 0.11, 0.03, -0.02), (0.055, 0.03, 0.008, -0.055)):
        outline = rounded_rectangle(length / 2.0, wide / 2.0, 0.45 * wide, 2)
        rings.append(np.column_stack([outline[:, 0] + x + back, outline[:, 1], np.full(len(outline), z + high)]))
    return loft("trim", rings, 50.0, caps=True)


def roof_rail(shape: CarShape, ends: tuple[float, float]) -> Part:
    """A rail along the roof's left edge from one x to another."""
    x = np.linspace(ends[0], ends[1], 9)
    line: Floats = np.stack([x, np.interp(x, *np.array(shape.cabin).T) - 0.20, np.full(9, 1.8)], axis=1)
    for _ in range(30):
        line[:, 2] -= 0.9 * shape.greenhouse(line)
    line[:, 2] += np.array([-0.01, 0.028, *[0.034] * 5, 0.028, -0.01])
    return tube("trim", line, 0.016, 6)
