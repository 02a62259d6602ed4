"""Parked vehicles: those of traffic with fewer triangles, since dozens of them stand in one image.

Edges are collapsed by quadric errors (Garland and Heckbert 1997), in Blender's modifier. Normals, tints and ambient
occlusion are those of the full model at the nearest point of the same material.
"""

from dataclasses import replace
from functools import partial
from typing import Final

import bmesh
import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from assets.models.common import MODELS, Floats, Ints, Model, Part, ambient_occlusion, model

KINDS: Final = ("hatchback", "compact", "saloon", "suv", "van", "light_truck")
"""Those that park at the roadside; motorcycles have a parked model of their own."""

TRIANGLES: Final = 3600
FAR_TRIANGLES: Final = 1200
SHADOW_TRIANGLES: Final = 500
"""Of the body, of the one that is drawn from far away, and of the one that only casts the shadow."""

OPEN: Final = "gap"
"""The material of wheel arches, sheets that are seen from both sides. All others are seen from outside only, so that
back faces need not be drawn."""

WELD_M: Final = 0.0005

SMOOTH: Final = 0.75
FACING: Final = 0.3
"""Least cosines between a triangle and the normal that it takes over: that of a corner itself, which may lie on an edge
with two sides, and that of a place next to it, within the triangle."""


def parked(name: str) -> Model:
    """The parked model of a kind: its parts `body`, `far` and `shadow`."""
    whole = MODELS[name]().parts
    openness = ambient_occlusion(whole)
    shaded = [replace(one, tint=one.tint * open_[:, None]) for one, open_ in zip(whole, openness, strict=True)]
    nodes = [
        Model("body", collapsed(shaded, TRIANGLES, keeps_outlines=True), reach_m=0.0),
        Model("far", collapsed(shaded, FAR_TRIANGLES), reach_m=0.0),
        Model("shadow", collapsed(shaded, SHADOW_TRIANGLES), reach_m=0.0),
    ]
    return Model(f"{name}_parked", nodes=nodes)


for _name in KINDS:
    model(f"{_name}_parked")(partial(parked, _name))


def collapsed(parts: list[Part], triangles: int, *, keeps_outlines: bool = False) -> list[Part]:
    """The parts as one mesh with about so many triangles, a part for each material again. With `keeps_outlines` the
    vertices between two materials stay."""
    materials = list(dict.fromkeys(one.material for one in parts))
    points, faces, owners = _collapsed(parts, materials, triangles, keeps_outlines=keeps_outlines)
    originals = [_Original([one for one in parts if one.material == name]) for name in materials]
    made = []
    for number, (name, original) in enumerate(zip(materials, originals, strict=True)):
        mine = faces[owners == number]
        if len(mine):
            made.append(_dressed(name, points, mine, original))
    return [*made, *(_turned_over(one) for one in made if one.material == OPEN)]


def _turned_over(part: Part) -> Part:
    """The same triangles, facing the other way."""
    return replace(part, triangles=part.triangles[:, ::-1].copy(), normals=-part.normals)


def _collapsed(
    parts: list[Part], materials: list[str], triangles: int, *, keeps_outlines: bool
) -> tuple[Floats, Ints, Ints]:
    """Vertices (n, 3), triangles (m, 3), and the material of each (m,)."""
    starts = np.cumsum([0, *(len(one.vertices) for one in parts[:-1])])
    indices = np.concatenate([one.triangles + start for one, start in zip(parts, starts, strict=True)])
    owners = np.repeat([materials.index(one.material) for one in parts], [len(one.triangles) for one in parts])
    mesh = bpy.data.meshes.new("vehicle")
    mesh.from_pydata(np.concatenate([one.vertices for one in parts]).tolist(), [], indices.tolist())
    for _ in materials:
        mesh.materials.append(None)
    mesh.polygons.foreach_set("material_index", owners.astype(np.int32))
    edited = bmesh.new()
    edited.from_mesh(mesh)
    bmesh.ops.remove_doubles(edited, verts=edited.verts, dist=WELD_M)
    edited.to_mesh(mesh)
    edited.free()
    thing = bpy.data.objects.new("vehicle", mesh)
    bpy.context.scene.collection.objects.link(thing)
    modifier = thing.modifiers.new("collapse", "DECIMATE")
    modifier.ratio = min(1.0, triangles / len(mesh.polygons))
    modifier.use_collapse_triangulate = True
    if keeps_outlines:
        group = thing.vertex_groups.new(name="free")
        group.add(_within_one_material(mesh), 1.0, "REPLACE")
        modifier.vertex_group = group.name
    seen = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.array([vertex.co[:] for vertex in seen.vertices], dtype=np.float64)
    points[:, 2] = np.maximum(points[:, 2], 0.0)  # tyres do not reach below the ground
    faces = np.array([face.vertices[:] for face in seen.polygons], dtype=np.int64)
    kept = np.array([face.material_index for face in seen.polygons], dtype=np.int64)
    bpy.data.objects.remove(thing)
    bpy.data.meshes.remove(mesh)
    return points, faces, kept


def _within_one_material(mesh: bpy.types.Mesh) -> list[int]:
    """The vertices whose triangles are all of one material."""
    around: dict[int, set[int]] = {}
    for face in mesh.polygons:
        for vertex in face.vertices:
            around.setdefault(vertex, set()).add(face.material_index)
    return [vertex for vertex, found in around.items() if len(found) == 1]


class _Original:
    """The full model's triangles of one material, to look up normals and tints."""

    def __init__(self, parts: list[Part]) -> None:
        starts = np.cumsum([0, *(len(one.vertices) for one in parts[:-1])])
        self.points = np.concatenate([one.vertices for one in parts])
        self.normals = np.concatenate([one.normals for one in parts])
        self.tints = np.concatenate([one.tint for one in parts])
        self.triangles = np.concatenate([one.triangles + start for one, start in zip(parts, starts, strict=True)])
        self.tree = BVHTree.FromPolygons(self.points.tolist(), self.triangles.tolist())

    def normal_at(self, point: Floats) -> Floats:
        """The unit normal (3,) at the nearest point."""
        corners, shares = self._nearest(point)
        normal = shares @ self.normals[corners]
        return normal / max(float(np.linalg.norm(normal)), 1e-9)

    def tint_at(self, point: Floats) -> Floats:
        """The tint (3,) at the nearest point."""
        corners, shares = self._nearest(point)
        return shares @ self.tints[corners]

    def _nearest(self, point: Floats) -> tuple[Ints, Floats]:
        """The triangle's vertices (3,) at the nearest point, and their shares there (3,)."""
        place, _, number, _ = self.tree.find_nearest(Vector(point.tolist()))
        corners = self.triangles[number]
        (a, b, c), p = self.points[corners], np.array(place)
        total = np.linalg.norm(np.cross(b - a, c - a))
        shares = np.array(
            [np.linalg.norm(np.cross(one - p, other - p)) for one, other in ((b, c), (c, a), (a, b))]
        ) / max(total, 1e-12)
        return corners, shares


def _dressed(material: str, points: Floats, faces: Ints, original: _Original) -> Part:
    """A part whose normals and tints are the full model's; where those look away, a triangle keeps its own."""
    rows: dict[tuple[int, bytes], int] = {}
    vertices, normals, tints, triangles = [], [], [], []
    for face in faces:
        a, b, c = points[face]
        flat = np.cross(b - a, c - a)
        area = float(np.linalg.norm(flat))
        if area < 1e-10:
            continue
        flat /= area
        corners = []
        for corner in face.tolist():
            middle = (a + b + c) / 3
            normal = next(
                (
                    there
                    for share, least in ((0.0, SMOOTH), (0.1, FACING))
                    if (there := original.normal_at((1 - share) * points[corner] + share * middle)) @ flat > least
                ),
                flat,
            )
            # The dark of a narrow gap must not spread over the triangle beside it.
            tint = original.tint_at(0.6 * points[corner] + 0.4 * middle)
            key = corner, np.round([*(8.0 * normal), *(6.0 * tint)]).tobytes()
            if key not in rows:
                rows[key] = len(vertices)
                vertices.append(points[corner])
                normals.append(normal)
                tints.append(tint)
            corners.append(rows[key])
        triangles.append(corners)
    return Part(material, np.array(vertices), np.array(triangles), np.array(normals), np.array(tints))
