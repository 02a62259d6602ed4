"""Wheels: tyre, rim with spokes, brake disc behind."""

import numpy as np

from assets.models.common import Part, part
from assets.models.shapes import lathe


def wheel(radius_m: float, width_m: float, rim_share: float = 0.66, spokes: int = 5, steps: int = 24) -> list[Part]:
    """A wheel with its outer face at y = 0 looking along +y, its axle at the origin. Its inner face is left open."""
    rim, r = rim_share * radius_m, radius_m
    outside = [(r, 0.04 - width_m), (r, -0.04), (r - 0.008, -0.015), (r - 0.035, 0.0), (rim, -0.006)]
    parts = [lathe("tyre", outside, steps, axis=1, smooth_deg=50.0)]
    parts.append(lathe("rim", [(rim + 0.002, -0.003), (rim - 0.016, -0.006), (rim - 0.012, -0.03)], steps, axis=1))
    parts.append(disc("gap", rim - 0.008, -0.075, steps // 2))
    parts.append(disc("metal", 0.68 * rim, -0.07, steps // 2))
    parts += _spokes(rim, spokes)
    return parts


def disc(material: str, radius: float, y: float, steps: int) -> Part:
    """A flat disc looking along +y."""
    angle = -2.0 * np.pi * np.arange(steps) / steps
    points = np.stack([radius * np.cos(angle), np.full(steps, y), radius * np.sin(angle)], axis=1)
    return part(material, points, [tuple(range(steps))])


def lorry_wheel(radius_m: float, width_m: float, twin: bool, steps: int = 24) -> list[Part]:
    """A wheel of a truck or bus: a deep rim where the tyres are twins, one that stands out where it is single."""
    rim, r = 0.56 * radius_m, radius_m
    outside = [(r, 0.06 - width_m), (r, -0.05), (r - 0.02, -0.015), (r - 0.07, 0.0), (rim, -0.02)]
    deep, hub = (-0.16, -0.05) if twin else (-0.03, 0.02)
    inner = [
        (rim + 0.01, -0.015),
        (rim - 0.03, -0.03),
        (0.62 * rim, deep),
        (0.45 * rim, deep),
        (0.40 * rim, hub),
        (1e-4, hub),
    ]
    return [
        lathe("tyre", outside, steps, axis=1, smooth_deg=50.0),
        lathe("rim", inner, steps, axis=1, smooth_deg=30.0),
    ]


def _spokes(rim: float, count: int) -> list[Part]:
    """Spokes that widen to the rim and dish towards the hub, and the hub's cap."""
    out = []
    stations = [(0.10, 0.24, -0.030), (0.45, 0.13, -0.022), (0.97, 0.20, -0.012)]
    for k in range(count):
        angle = 2.0 * np.pi * k / count + np.pi / 2.0
        along, across = np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([-np.sin(angle), 0.0, np.cos(angle)])
        rows = []
        for share, wide, y in stations:
            middle = rim * share * along + np.array([0.0, y, 0.0])
            edge, flat = 0.5 * rim * wide * across, np.array([0.0, 0.02, 0.0])
            rows += [middle - edge - flat, middle - 0.7 * edge, middle + 0.7 * edge, middle + edge - flat]
        faces = [(4 * i + j, 4 * i + j + 1, 4 * i + 5 + j, 4 * i + 4 + j) for i in range(2) for j in range(3)]
        out.append(part("rim", np.array(rows), faces, 30.0))
    out.append(lathe("rim", [(0.20 * rim, -0.03), (0.16 * rim, -0.018), (1e-4, -0.016)], 10, axis=1))
    return out
