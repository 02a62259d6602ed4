"""What every family of models shares: the parts of a model, shading, ambient occlusion and the registry of models.

A model is made in its own frame: x forward, y left, z up, metres, origin on the ground below the middle of its
footprint. It is a list of parts, each a triangle mesh of one material whose vertices have normals already: vertices on
a sharp edge are there once for each side.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import bpy  # noqa: F401  (mathutils is inside it, and is found only once it is loaded)
import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from assets.models.materials import MATERIALS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Faces = Sequence[Sequence[int]] | Ints

AO_RAYS: Final = 96
"""Rays about a vertex; on the cosine-weighted half-sphere their hits are the occlusion itself."""


@dataclass(slots=True)
class Part:
    """A triangle mesh of one material. `tint` (n, 3) in [0, 1] multiplies the material's colour, besides occlusion."""

    material: str
    vertices: Floats
    triangles: Ints
    normals: Floats
    tint: Floats
    uv: Floats | None = None
    """(n, 2) of leaves: over the sheet that they are cut out of, `pavetwin.scene.foliage`."""

    def __post_init__(self) -> None:
        n = len(self.vertices)
        if self.material not in MATERIALS:
            raise ValueError(f"no material is called {self.material!r}; they are listed in assets/models/materials.py")
        if self.vertices.shape != (n, 3) or self.normals.shape != (n, 3) or self.tint.shape != (n, 3):
            raise ValueError(f"{self.material}: vertices, normals and tint are not (n, 3) each")
        if self.uv is not None and self.uv.shape != (n, 2):
            raise ValueError(f"{self.material}: texture coordinates are not (n, 2)")
        if self.triangles.ndim != 2 or self.triangles.shape[1] != 3:
            raise ValueError(f"{self.material}: triangles are not (m, 3)")

    def moved(self, by: Sequence[float] | Floats) -> "Part":
        """The part shifted by `by`, in metres."""
        return Part(self.material, self.vertices + np.asarray(by), self.triangles, self.normals, self.tint, self.uv)

    def turned(self, matrix: Floats) -> "Part":
        """The part under a 3 × 3 matrix: a rotation, a scale or a mirror."""
        normals = self.normals @ np.linalg.inv(matrix)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        triangles = self.triangles if np.linalg.det(matrix) > 0 else self.triangles[:, ::-1]
        return Part(self.material, self.vertices @ matrix.T, triangles, normals, self.tint, self.uv)

    def mirrored(self) -> "Part":
        """The part on the other side: y becomes −y."""
        return self.turned(np.diag([1.0, -1.0, 1.0]))


@dataclass(slots=True)
class Model:
    """A named list of parts; or, where `nodes` are given, several of them in one file: poses, trunk and crown."""

    name: str
    parts: list[Part] = field(default_factory=list)
    nodes: list["Model"] = field(default_factory=list)
    extras: dict[str, float | str] = field(default_factory=dict)
    """Numbers that go with the model (the file's) or with one node of it."""
    colours: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    """Base colours by material where this model's differ from the list's, linear RGB."""
    reach_m: float = 0.8
    """How far ambient occlusion looks; 0 where the tints of the parts say it all."""

    def add(self, *parts: Part) -> None:
        self.parts.extend(parts)

    def add_both_sides(self, *parts: Part) -> None:
        """The parts, and their mirror images at y → −y."""
        for part in parts:
            self.parts += [part, part.mirrored()]

    def by_material(self) -> dict[str, Part]:
        """One part a material, in the order of the materials' list, ready to be written."""
        return {
            name: merged([part for part in self.parts if part.material == name])
            for name in MATERIALS
            if any(part.material == name for part in self.parts)
        }

    def meshes(self) -> list["Model"]:
        """What becomes a mesh node each: the nodes, or the model itself."""
        return self.nodes or [self]


MODELS: Final[dict[str, Callable[[], Model]]] = {}
"""What makes each model, by name."""


def model(name: str) -> Callable[[Callable[[], Model]], Callable[[], Model]]:
    """Registers a function as what makes the model `name`."""

    def register(make: Callable[[], Model]) -> Callable[[], Model]:
        if name in MODELS:
            raise ValueError(f"two models are called {name!r}")
        MODELS[name] = make
        return make

    return register


def merged(parts: Sequence[Part]) -> Part:
    """Several parts of one material as one; they have texture coordinates all or none."""
    uvs = [part.uv for part in parts if part.uv is not None]
    if len(uvs) not in (0, len(parts)):
        raise ValueError(f"{parts[0].material}: some parts have texture coordinates and some have not")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Part(
        parts[0].material,
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.tint for part in parts]),
        np.concatenate(uvs) if uvs else None,
    )


def triangulated(faces: Faces) -> Ints:
    """Fans of triangles for faces of any number of corners: (m, 3)."""
    fans = [(face[0], face[i], face[i + 1]) for face in faces for i in range(1, len(face) - 1)]
    return np.array(fans, dtype=np.int64).reshape(-1, 3)


def part(
    material: str,
    vertices: Floats | Sequence[Sequence[float]],
    faces: Faces,
    smooth_deg: float = 35.0,
    tint: Sequence[float] | float = 1.0,
) -> Part:
    """A part from a polygon mesh: smooth where neighbouring faces meet at less than `smooth_deg`, sharp elsewhere.

    Faces are counter-clockwise seen from outside. Faces without area are left out.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), triangulated(faces)
    crosses = np.cross(
        points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    )
    areas = np.linalg.norm(crosses, axis=1)
    triangles, crosses, areas = triangles[areas > 1e-12], crosses[areas > 1e-12], areas[areas > 1e-12]
    corners = _corner_normals(points, triangles, crosses, crosses / areas[:, None], smooth_deg)
    return _welded(material, points[triangles.reshape(-1)], corners, tint)


def _corner_normals(points: Floats, triangles: Ints, crosses: Floats, units: Floats, smooth_deg: float) -> Floats:
    """The normal at each corner (3 m, 3): the area-weighted mean of the faces there within the limit."""
    _, place = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    place = place.reshape(-1)[triangles].reshape(-1)
    around: dict[int, list[int]] = {}
    for corner, spot in enumerate(place):
        around.setdefault(int(spot), []).append(corner // 3)
    limit = np.cos(np.radians(smooth_deg))
    normals = np.empty((len(place), 3))
    for corner, spot in enumerate(place):
        faces = np.array(around[int(spot)])
        near = faces[units[faces] @ units[corner // 3] >= limit - 1e-9]
        total = crosses[near].sum(axis=0)
        normals[corner] = total / max(float(np.linalg.norm(total)), 1e-12)
    return normals


def _welded(material: str, corners: Floats, normals: Floats, tint: Sequence[float] | float) -> Part:
    """Corners that agree in place and normal become one vertex, in the order they first appear."""
    keys = np.round(np.concatenate([corners, normals], axis=1), 5)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    first = first[order]
    colours = np.broadcast_to(np.asarray(tint, dtype=np.float64), (len(first), 3)).copy()
    return Part(material, corners[first], rank[inverse.reshape(-1)].reshape(-1, 3), normals[first], colours)


def half_sphere(count: int) -> Floats:
    """Directions (count, 3) about +z, dense as the cosine: a Fibonacci spiral."""
    i = np.arange(count) + 0.5
    radius, angle = np.sqrt(i / count), i * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius**2)], axis=1)


def ambient_occlusion(parts: Iterable[Part], reach_m: float = 0.8, ground: bool = True) -> list[Floats]:
    """How open each vertex is, in [0, 1]: one array (n,) a part.

    A ray that hits something near counts nearly whole and one that hits at `reach_m` not at all, so that big flat
    faces stay clean. With `ground`, the plane z = 0 hides too.
    """
    parts = list(parts)
    if reach_m <= 0.0:
        return [np.ones(len(one.vertices)) for one in parts]
    points = np.concatenate([one.vertices for one in parts])
    starts = np.cumsum([0, *(len(one.vertices) for one in parts[:-1])])
    faces = np.concatenate([one.triangles + start for one, start in zip(parts, starts, strict=True)]).tolist()
    if ground:
        corners = [(-50.0, -50.0, 0.0), (50.0, -50.0, 0.0), (50.0, 50.0, 0.0), (-50.0, 50.0, 0.0)]
        faces.append(list(range(len(points), len(points) + 4)))
        tree = BVHTree.FromPolygons([*map(tuple, points.tolist()), *corners], faces)
    else:
        tree = BVHTree.FromPolygons(list(map(tuple, points.tolist())), faces)
    return [_part_openness(tree, one, reach_m) for one in parts]


def _part_openness(tree: BVHTree, one: Part, reach_m: float) -> Floats:
    """The mean about each vertex, half-way to the middles of its triangles: so nothing small darkens a big face."""
    rays = half_sphere(AO_RAYS // 6)
    total, count = np.zeros(len(one.vertices)), np.zeros(len(one.vertices))
    for triangle in one.triangles:
        middle = one.vertices[triangle].mean(axis=0)
        for vertex in triangle:
            point = 0.6 * one.vertices[vertex] + 0.4 * middle
            total[vertex] += _openness(tree, point, one.normals[vertex], rays, reach_m)
            count[vertex] += 1
    return np.asarray(total / np.maximum(count, 1))


def _openness(tree: BVHTree, point: Floats, normal: Floats, rays: Floats, reach_m: float) -> float:
    side = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    tangent = np.cross(side, normal)
    tangent /= np.linalg.norm(tangent)
    world = rays @ np.stack([tangent, np.cross(normal, tangent), normal])
    origin = tuple((point + 0.004 * normal).tolist())
    hidden = 0.0
    for direction in world.tolist():
        distance = tree.ray_cast(origin, direction, reach_m)[3]
        if distance is not None:
            hidden += 1.0 - (distance / reach_m) ** 2
    return 1.0 - hidden / len(rays)
