"""Smooth bodies from implicit functions, and pictures cut into them.

A body is a function f(points (n, 3)) → (n,): negative inside, about the distance in metres near the surface. It is
meshed by surface nets (Gibson, 1998), thinned by Blender's quadric collapse and put back on f = 0. Windows, gaps, lamps
and plates are cut into the mesh along g = 0 of further functions, so that their outlines are curves and not steps of
the mesh; the normals are f's gradient, so that cutting never shows in the shading.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import bpy
import numpy as np
from numpy.typing import NDArray

from assets.models.common import Floats, Ints

Field = Callable[[Floats], Floats]
Mask = NDArray[np.bool_]

OUTLINE_M: Final = 0.0015
"""How far a cut may stray from its curve, in metres."""
ISLAND_M: Final = 0.08
"""Edges above this are split beside a curve too: it may lie inside a triangle whole."""
SHORTEST_M: Final = 0.02
"""Edges below this are not split to follow a curve, in metres."""


@dataclass(slots=True)
class Skin:
    """A triangle mesh on f = 0: vertices (n, 3), triangles (m, 3) and the label of each triangle (m,)."""

    field: Field
    vertices: Floats
    triangles: Ints
    labels: Ints

    def centres(self) -> Floats:
        return np.asarray(self.vertices[self.triangles].mean(axis=1))

    def normals(self) -> Floats:
        """The gradient's direction at the vertices, (n, 3)."""
        return directions(self.field, self.vertices)

    def keep(self, wanted: Mask) -> None:
        """Drops the triangles where `wanted` is false, and vertices no longer used."""
        used, inverse = np.unique(self.triangles[wanted], return_inverse=True)
        self.vertices, self.labels = self.vertices[used], self.labels[wanted]
        self.triangles = inverse.reshape(-1, 3).astype(np.int64)

    def cut(self, shape: Field, level: float = 0.0) -> Floats:
        """Splits triangles along shape = level, refining where the outline curves. Returns shape at the centres."""
        for _ in range(6):
            if not self._refine(shape, level):
                break
        self._split(shape, level)
        return shape(self.centres())

    def paint(self, shape: Field, label: int, over: tuple[int, ...] | None = None) -> None:
        """Cuts along shape = 0 and labels the inside; `over` limits it to triangles of those labels."""
        inside = self.cut(shape) < 0.0
        self._label(inside, label, over)

    def stroke(self, shape: Field, width_m: float, label: int, where: Field, over: tuple[int, ...]) -> None:
        """Labels the band of `width_m` about shape = 0 as far as `where` is negative. `where` is not cut along."""
        self.cut(shape, -width_m / 2.0)
        value = self.cut(shape, width_m / 2.0)
        self._label((np.abs(value) < width_m / 2.0) & (where(self.centres()) < 0.0), label, over)

    def _label(self, inside: Mask, label: int, over: tuple[int, ...] | None) -> None:
        allowed = np.ones(len(self.labels), dtype=bool) if over is None else np.isin(self.labels, over)
        self.labels[inside & allowed] = label

    def _edges(self) -> tuple[Ints, Ints]:
        """Edges (e, 2), lower index first, and for each triangle its edges ab, bc, ca as indices (m, 3)."""
        sides = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        count = len(self.vertices)
        keys, inverse = np.unique(sides[:, 0] * count + sides[:, 1], return_inverse=True)
        return np.stack([keys // count, keys % count], axis=1), inverse.reshape(-1, 3)

    def _refine(self, shape: Field, level: float) -> bool:
        edges, _ = self._edges()
        ends = self.vertices[edges]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        value = shape(self.vertices)[edges] - level
        near = (np.abs(value).min(axis=1) < 0.7 * length) & (length > SHORTEST_M)
        if not near.any():
            return False
        middles = on_surface(self.field, ends[near].mean(axis=1), 1)
        between = shape(middles) - level
        bend = np.abs(between - value[near].mean(axis=1))
        crossed = (value[near] * between[:, None] < 0.0).any(axis=1)
        close = crossed | ((np.abs(between) < 0.6 * length[near]) & (length[near] > ISLAND_M))
        wrong = np.zeros(len(edges), dtype=bool)
        wrong[np.flatnonzero(near)[(bend > OUTLINE_M) & close]] = True
        if not wrong.any():
            return False
        self._halve(wrong)
        return True

    def _halve(self, chosen: Mask) -> None:
        """Splits the chosen edges at their middles, and the triangles beside them into two, three or four."""
        edges, sides = self._edges()
        new = np.full(len(edges), -1, dtype=np.int64)
        new[chosen] = len(self.vertices) + np.arange(int(chosen.sum()))
        middles = on_surface(self.field, self.vertices[edges[chosen]].mean(axis=1), 2)
        self.vertices = np.concatenate([self.vertices, middles])
        mids = new[sides]
        touched = (mids >= 0).any(axis=1)
        triangles: list[tuple[int, int, int]] = []
        labels: list[int] = []
        for corners, on_edges, label in zip(
            self.triangles[touched].tolist(), mids[touched].tolist(), self.labels[touched].tolist(), strict=True
        ):
            pieces = _pieces(corners, on_edges)
            triangles += pieces
            labels += [label] * len(pieces)
        self.triangles = np.concatenate([self.triangles[~touched], np.array(triangles, dtype=np.int64)])
        self.labels = np.concatenate([self.labels[~touched], np.array(labels, dtype=np.int64)])

    def _split(self, shape: Field, level: float) -> None:
        value = shape(self.vertices) - level
        value[np.abs(value) < 1e-6] = 1e-6
        edges, sides = self._edges()
        pair = value[edges]
        crossing = pair[:, 0] * pair[:, 1] < 0.0
        if not crossing.any():
            return
        share = pair[crossing, 0] / (pair[crossing, 0] - pair[crossing, 1])
        ends = self.vertices[edges[crossing]]
        points = on_surface(self.field, ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0]), 1)
        new = np.full(len(edges), -1, dtype=np.int64)
        new[crossing] = len(self.vertices) + np.arange(len(points))
        self.vertices = np.concatenate([self.vertices, points])
        mids = new[sides]
        whole = (mids < 0).all(axis=1)
        # The corner that is alone on its side first; its two edges are the split ones.
        alone = np.argmax(mids[:, [1, 2, 0]] < 0, axis=1)[~whole]
        turn = (alone[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(self.triangles[~whole], turn, axis=1)
        cuts = np.take_along_axis(mids[~whole], turn, axis=1)
        a, b, c, p, q = corners[:, 0], corners[:, 1], corners[:, 2], cuts[:, 0], cuts[:, 2]
        short = _distance(self.vertices, p, c) < _distance(self.vertices, q, b)
        first = np.where(short[:, None], np.stack([p, b, c], axis=1), np.stack([p, b, q], axis=1))
        second = np.where(short[:, None], np.stack([p, c, q], axis=1), np.stack([b, c, q], axis=1))
        self.triangles = np.concatenate([self.triangles[whole], np.stack([a, p, q], axis=1), first, second])
        self.labels = np.concatenate([self.labels[whole], *[self.labels[~whole]] * 3])


def _distance(points: Floats, one: Ints, other: Ints) -> Floats:
    return np.asarray(np.linalg.norm(points[one] - points[other], axis=1))


def _pieces(corners: list[int], mids: list[int]) -> list[tuple[int, int, int]]:
    """A triangle a, b, c with new points on some of its edges ab, bc, ca (−1 where not), in pieces."""
    a, b, c = corners
    ab, bc, ca = mids
    count = sum(mid >= 0 for mid in mids)
    if count == 0:
        return [(a, b, c)]
    if count == 3:
        return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    if count == 1:
        if ab >= 0:
            return [(a, ab, c), (ab, b, c)]
        return [(a, b, bc), (a, bc, c)] if bc >= 0 else [(a, b, ca), (ca, b, c)]
    if ab < 0:
        return [(a, b, bc), (a, bc, ca), (ca, bc, c)]
    if bc < 0:
        return [(a, ab, ca), (ab, b, c), (ab, c, ca)]
    return [(ab, b, bc), (a, ab, c), (ab, bc, c)]


def directions(field: Field, points: Floats, step: float = 1e-3) -> Floats:
    """The unit gradient (n, 3) by central differences."""
    slope = gradient(field, points, step)
    return np.asarray(slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12))


def gradient(field: Field, points: Floats, step: float = 1e-3) -> Floats:
    n = len(points)
    around = np.concatenate([points + offset for axis in np.eye(3) for offset in (step * axis, -step * axis)])
    values = field(around).reshape(3, 2, n)
    return np.asarray((values[:, 0] - values[:, 1]).T / (2.0 * step))


def on_surface(field: Field, points: Floats, steps: int = 5) -> Floats:
    """The points moved onto f = 0 by Newton's steps along the gradient, each of at most 5 cm."""
    for _ in range(steps):
        slope = gradient(field, points)
        move = (field(points) / np.maximum((slope**2).sum(axis=1), 1e-6))[:, None] * slope
        length = np.linalg.norm(move, axis=1, keepdims=True)
        points = points - move * np.minimum(1.0, 0.05 / np.maximum(length, 1e-9))
    return points


def mesh(field: Field, low: Floats, high: Floats, cell_m: float, triangles: int) -> Skin:
    """The surface f = 0 inside a box as about `triangles` triangles."""
    vertices, faces = _surface_nets(field, np.asarray(low), np.asarray(high), cell_m)
    vertices = on_surface(field, vertices)
    vertices, faces = _thinned(vertices, faces, triangles)
    return Skin(field, on_surface(field, vertices), faces, np.zeros(len(faces), dtype=np.int64))


def _surface_nets(field: Field, low: Floats, high: Floats, cell: float) -> tuple[Floats, Ints]:
    size = np.ceil((high - low) / cell).astype(int) + 1
    axes = [low[k] + cell * np.arange(size[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = field(grid.reshape(-1, 3)).reshape(size)
    inside = values < 0.0
    total, count = np.zeros((*(size - 1), 3)), np.zeros(size - 1)
    faces: list[Ints] = []
    number = np.arange(int(np.prod(size - 1))).reshape(size - 1)
    for axis in range(3):
        lower, upper = [slice(None)] * 3, [slice(None)] * 3
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        one, other = values[tuple(lower)], values[tuple(upper)]
        cross = np.argwhere((one < 0.0) != (other < 0.0))
        share = one[tuple(cross.T)] / (one[tuple(cross.T)] - other[tuple(cross.T)])
        places = grid[tuple(cross.T)].copy()
        places[:, axis] += cell * share
        u, v = (axis + 1) % 3, (axis + 2) % 3
        safe = (cross[:, u] > 0) & (cross[:, v] > 0) & (cross[:, u] < size[u] - 1) & (cross[:, v] < size[v] - 1)
        cross, places = cross[safe], places[safe]
        corners = []
        for du, dv in ((1, 1), (0, 1), (0, 0), (1, 0)):
            index = cross.copy()
            index[:, u] -= du
            index[:, v] -= dv
            np.add.at(total, tuple(index.T), places)
            np.add.at(count, tuple(index.T), 1)
            corners.append(number[tuple(index.T)])
        quads = np.stack(corners, axis=1)
        flip = ~inside[tuple(cross.T)]
        quads[flip] = quads[flip][:, ::-1]
        faces.append(quads)
    quads = np.concatenate(faces)
    used, inverse = np.unique(quads, return_inverse=True)
    quads = inverse.reshape(-1, 4)
    vertices = total.reshape(-1, 3)[used] / count.reshape(-1)[used, None]
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _thinned(vertices: Floats, faces: Ints, triangles: int) -> tuple[Floats, Ints]:
    """Fewer triangles, by Blender's quadric edge collapse."""
    data = bpy.data.meshes.new("body")
    data.from_pydata(vertices.tolist(), [], faces.tolist())
    thing = bpy.data.objects.new("body", data)
    bpy.context.scene.collection.objects.link(thing)
    modifier = thing.modifiers.new("thin", "DECIMATE")
    modifier.ratio = min(1.0, triangles / len(faces))
    modifier.use_collapse_triangulate = True
    result = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.array([tuple(vertex.co) for vertex in result.vertices])
    corners = np.array([tuple(face.vertices) for face in result.polygons], dtype=np.int64)
    bpy.data.objects.remove(thing)
    bpy.data.meshes.remove(data)
    return points, corners
