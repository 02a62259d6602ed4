"""Skins over rings whose normals run smoothly all over: limbs, clothes, heads, boughs. Metres, x forward, y left, z up.

`shapes` has the solids with edges; here nothing has any, and a skin's vertices are shared, so it stays small.
"""

from collections.abc import Sequence

import numpy as np

from assets.models.common import Floats, Ints, Part


def unit(vectors: Floats) -> Floats:
    """Vectors of length one along the last axis."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def rotation(axis: str, angle_rad: float) -> Floats:
    """The matrix of a right-handed turn about x, y or z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix


def ring_angles(sides: int) -> Floats:
    """Angles round a ring, half a step off the axes, so that a mirrored ring falls on itself."""
    return np.asarray((np.arange(sides) + 0.5) * (2.0 * np.pi / sides), dtype=np.float64)


def superellipse(sides: int, half_x: float, half_y: float, exponent: float = 2.0) -> Floats:
    """|x/a|ⁿ + |y/b|ⁿ = 1 at `sides` even angles, (sides, 2), counter-clockwise. 2 is an ellipse, more is squarer."""
    angle = ring_angles(sides)
    c, s = np.cos(angle), np.sin(angle)
    power = 2.0 / exponent
    return np.stack([half_x * np.sign(c) * np.abs(c) ** power, half_y * np.sign(s) * np.abs(s) ** power], axis=-1)


def vertex_normals(vertices: Floats, triangles: Ints) -> Floats:
    """Unit normals (n, 3): the area-weighted mean of the faces about each vertex."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(total, triangles[:, corner], face)
    return unit(total)


def smooth(material: str, vertices: Floats, triangles: Ints, tint: Floats | float = 1.0) -> Part:
    """A part with smooth normals, less triangles without area. `tint`: one, one a vertex (n,), or colours (n, 3)."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    triangles = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-10]
    tint = np.asarray(tint, dtype=np.float64)
    tint = tint[:, None] if tint.ndim == 1 else tint
    colours = np.broadcast_to(tint, (len(vertices), 3))
    used, flat = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], flat.reshape(-1, 3)
    return Part(material, vertices, triangles, vertex_normals(vertices, triangles), colours[used])


def skin(
    material: str, rings: Sequence[Floats] | Floats, *, start: bool = True, end: bool = True, tint: Floats | float = 1.0
) -> Part:
    """The surface over rings of equally many points, each (s, 3), closed by a fan at its `start` and its `end`.

    Rings run counter-clockwise seen from the last one's end. `tint` is a number, or one a point of the rings (r, s).
    """
    stack = np.asarray(rings, dtype=np.float64)
    count, sides, _ = stack.shape
    index = np.arange(count * sides).reshape(count, sides)
    low, high = index[:-1], index[1:]
    low_next, high_next = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    triangles = [
        np.stack([low, low_next, high_next], axis=-1).reshape(-1, 3),
        np.stack([low, high_next, high], axis=-1).reshape(-1, 3),
    ]
    flat = stack.reshape(-1, 3)
    vertices = [flat]
    total = count * sides
    for wanted, ring, step in ((start, index[0], -1), (end, index[-1], 1)):
        if wanted:
            vertices.append(flat[ring].mean(axis=0, keepdims=True))
            around = np.stack([ring, np.roll(ring, -1)][::step], axis=-1)
            triangles.append(np.column_stack([around, np.full(sides, total)]))
            total += 1
    shade = np.concatenate([np.broadcast_to(tint, (count, sides)).reshape(-1), np.ones(total - count * sides)])
    return smooth(material, np.concatenate(vertices), np.concatenate(triangles), shade)


def rings_along(path: Floats, half: Floats, forward: Floats, sides: int = 8, exponent: float = 2.0) -> Floats:
    """Rings (r, sides, 3) square to a path (r, 3); ring i has the half axes `half[i]` = (along `forward`, across it).

    `forward`, (3,), counts as far as it is square to the path.
    """
    tangent = unit(np.gradient(path, axis=0))
    ahead = unit(forward - tangent * (tangent @ forward)[:, None])
    side = np.cross(tangent, ahead)
    out = np.empty((len(path), sides, 3))
    for i in range(len(path)):
        flat = superellipse(sides, half[i, 0], half[i, 1], exponent)
        out[i] = path[i] + flat[:, :1] * ahead[i] + flat[:, 1:] * side[i]
    return out
