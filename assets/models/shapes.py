"""Simple solids as parts: boxes with rounded edges, lathed and lofted shapes, tubes."""

from collections.abc import Sequence

import numpy as np

from assets.models.common import Floats, Part, part

Point = Sequence[float] | Floats


def box(material: str, low: Point, high: Point, bevel_m: float = 0.0, tint: float = 1.0) -> Part:
    """A box between two corners, in metres, its edges cut by `bevel_m` and shaded round."""
    if bevel_m <= 0.0:
        vertices = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        return part(material, vertices, faces, tint=tint)
    half, middle = (np.asarray(high) - np.asarray(low)) / 2.0, (np.asarray(high) + np.asarray(low)) / 2.0
    levels = [(-1.0, bevel_m), (-1.0, 0.0), (1.0, 0.0), (1.0, bevel_m)]
    rings = []
    for side, inset in levels:
        outline = rounded_rectangle(half[0] - inset, half[1] - inset, max(bevel_m - inset, 0.25 * bevel_m), 2)
        z = side * (half[2] - (bevel_m if inset == 0.0 else 0.0))
        rings.append(np.column_stack([outline, np.full(len(outline), z)]) + middle)
    return loft(material, rings, smooth_deg=50.0, caps=True, tint=tint)


def bordered(material: str, corner: Point, u: Point, v: Point, border_m: float, tint: float = 1.0) -> Part:
    """A rectangle from `corner` along u and v, looking along u × v, cut `border_m` inside its edges.

    What is fixed along the edges of a big face then darkens the border alone.
    """
    sides = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    at = [np.array([0.0, border_m / length, 1.0 - border_m / length, 1.0]) for length in map(np.linalg.norm, sides)]
    vertices = np.asarray(corner) + at[0][:, None, None] * sides[0] + at[1][None, :, None] * sides[1]
    faces = [(4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1) for i in range(3) for j in range(3)]
    return part(material, vertices.reshape(-1, 3), faces, tint=tint)


def ellipsoid(
    material: str, middle: Point, radii: Point, rings: int = 8, steps: int = 14, pitch_deg: float = 0.0
) -> Part:
    """An ellipsoid with half axes along x, y and z, its nose turned down by `pitch_deg`."""
    angle = np.linspace(-0.5 * np.pi + 1e-3, 0.5 * np.pi - 1e-3, rings + 1)
    ball = lathe(material, np.stack([np.cos(angle), np.sin(angle)], axis=1).tolist(), steps, smooth_deg=80.0)
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return ball.turned(turn @ np.diag(np.asarray(radii, dtype=np.float64))).moved(middle)


def rounded_rectangle(half_x: float, half_y: float, radius: float, steps: int = 4) -> Floats:
    """The outline (n, 2) of a rectangle about the origin with rounded corners, counter-clockwise."""
    turn = np.linspace(0.0, np.pi / 2.0, steps + 1)
    corner = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    inner = np.array([half_x - radius, half_y - radius])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    out, turned, signs = [], corner, [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    for sx, sy in signs:
        out.append(turned + inner * (sx, sy))
        turned = turned @ quarter.T
    return np.concatenate(out)


def loft(
    material: str,
    rings: Sequence[Floats],
    smooth_deg: float = 35.0,
    caps: bool = False,
    closed: bool = True,
    tint: float = 1.0,
) -> Part:
    """A skin over rings (n, 3) of equally many points, each counter-clockwise seen from the last ring's end."""
    n, count = len(rings[0]), len(rings)
    around = range(n) if closed else range(n - 1)
    faces: list[Sequence[int]] = [
        (k * n + i, k * n + (i + 1) % n, (k + 1) * n + (i + 1) % n, (k + 1) * n + i)
        for k in range(count - 1)
        for i in around
    ]
    if caps:
        faces += [tuple(range(n - 1, -1, -1)), tuple(range((count - 1) * n, count * n))]
    return part(material, np.concatenate(rings), faces, smooth_deg, tint)


def lathe(
    material: str, profile: Sequence[Point], steps: int, axis: int = 2, smooth_deg: float = 35.0, tint: float = 1.0
) -> Part:
    """A profile of (radius, height) turned about an axis (0 = x, 1 = y, 2 = z); heights rise."""
    angle = 2.0 * np.pi * np.arange(steps) / steps
    rings = []
    for radius, height in profile:
        ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(steps, height)], axis=1)
        rings.append(np.roll(ring, axis + 1, axis=1))
    return loft(material, rings, smooth_deg, tint=tint)


def tube(
    material: str, path: Sequence[Point] | Floats, radius_m: float | Sequence[float], sides: int = 8, tint: float = 1.0
) -> Part:
    """A round bar along a path, its ends closed; `radius_m` may differ from point to point."""
    points = np.asarray(path, dtype=np.float64)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    radii = np.broadcast_to(np.asarray(radius_m, dtype=np.float64), len(points))
    least = np.eye(3)[int(np.argmin(np.abs(along).max(axis=0)))]
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rings = []
    for point, forward, radius in zip(points, along, radii, strict=True):
        right = np.cross(least, forward)
        right /= np.linalg.norm(right)
        up = np.cross(forward, right)
        rings.append(point + radius * (np.cos(angle)[:, None] * right + np.sin(angle)[:, None] * up))
    return loft(material, rings, smooth_deg=60.0, caps=True, tint=tint)
