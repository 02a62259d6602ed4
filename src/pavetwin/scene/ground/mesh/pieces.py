"""The ground of a tile as meshes: one for each kind and finish, corners shared, holes where defects lie."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString

from pavetwin.arrays import Float32Array, Float64Array, Int64Array, UInt32Array
from pavetwin.scene.ground.layout.lines import ways_along
from pavetwin.scene.ground.layout.relief import PROFILE, Relief
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.mesh.regions import Face, faces_of
from pavetwin.scene.ground.plan import GroundPlan
from pavetwin.scene.model import TILE_M, GroundKind, GroundPiece, Mesh


def ground_pieces(plan: GroundPlan, key: tuple[int, int], *, has_holes: bool = True) -> tuple[GroundPiece, ...]:
    """The meshes of a tile's ground, in the tile's frame, in the order of their kinds and finishs.

    `has_holes`: whether the holes that patches of defects fill are left out.
    """
    relief = Relief(plan, tile_box(key))
    faces = faces_of(plan, key, relief, has_holes=has_holes)
    kinds = sorted({(face.kind, face.finish) for face in faces})
    alike = [[face for face in faces if (face.kind, face.finish) == each] for each in kinds]
    triangles = [_triangles(each) for each in alike]
    heights = _heights(relief, [corners.reshape(-1, 2) for corners, _ in triangles])
    return tuple(
        GroundPiece(kind, _mesh(plan, key, kind, mine, *parts, height), finish)
        for (kind, finish), mine, parts, height in zip(kinds, alike, triangles, heights, strict=True)
    )


def _heights(relief: Relief, points: Sequence[Float64Array]) -> list[Float64Array]:
    """Heights at the corners (n, 2) of each piece; once for corners that several share."""
    if not points:
        return []
    unique, back = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return np.split(relief.heights(unique)[back], np.cumsum([len(each) for each in points])[:-1])


def _mesh(
    plan: GroundPlan,
    key: tuple[int, int],
    kind: GroundKind,
    faces: Sequence[Face],
    corners: Float64Array,
    face: Int64Array,
    height: Float64Array,
) -> Mesh:
    """Of triangles' corners (n, 3, 2), the face of each triangle, and the heights (3 n,) of the corners."""
    flat = corners.reshape(-1, 2)
    uv = _coordinates(plan, kind, faces, corners, face).reshape(-1, 2)
    local = flat - np.array(key) * TILE_M
    rows = np.column_stack([local, height, uv])
    vertices, indices = np.unique(rows, axis=0, return_inverse=True)
    triangles = np.asarray(indices, dtype=np.uint32).reshape(-1, 3)
    return Mesh(
        positions=vertices[:, :3].astype(np.float32),
        normals=_normals(vertices[:, :3], triangles),
        indices=triangles,
        uv=vertices[:, 3:].astype(np.float32),
    )


def _triangles(faces: Sequence[Face]) -> tuple[Float64Array, Int64Array]:
    """Anticlockwise corners (n, 3, 2) of the faces' triangles, and the face of each."""
    parts = shapely.constrained_delaunay_triangles(np.array([face.polygon for face in faces], dtype=object))
    triangles, face = shapely.get_parts(parts, return_index=True)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    clockwise = ax * by - ay * bx < 0
    corners[clockwise] = corners[clockwise][:, ::-1]
    return corners, face


def _coordinates(
    plan: GroundPlan, kind: GroundKind, faces: Sequence[Face], corners: Float64Array, face: Int64Array
) -> Float64Array:
    """Where each corner (n, 3) lies in its detail, metres (n, 3, 2)."""
    if kind is GroundKind.KERB:
        return _on_kerb(plan, corners)
    uv = corners.copy()
    gutters = np.array([each.gutter for each in faces])[face]
    if gutters.any():
        uv[gutters] = _on_kerb(plan, corners[gutters])
    walks = np.array([each.walk for each in faces])[face]
    for walk in np.unique(walks[walks >= 0]):
        mine = walks == walk
        uv[mine] = _along(plan.sidewalk_lines[walk], corners[mine])
    return uv


def _on_kerb(plan: GroundPlan, corners: Float64Array) -> Float64Array:
    """Along the carriageway's edge, and up the section and over its top, for the corners (n, 3, 2) of triangles.

    In gutters the second is the way to the edge, below 0.
    """
    way, length, distance = (part.reshape(-1, 3) for part in plan.edges.locate(corners.reshape(-1, 2)))
    # A triangle across the point where its ring begins goes on beyond the ring's length.
    torn = np.ptp(way, axis=1) > length.min(axis=1) / 2
    way = way + np.where(torn[:, None] & (way < length / 2), length, 0.0)
    inside = np.asarray(shapely.intersects(plan.road, shapely.points(corners.mean(axis=1))))
    section = np.array(PROFILE)
    over = np.interp(distance, section[:, 0], section[:, 2])
    return np.stack([way, np.where(inside[:, None], -distance, over)], axis=-1)


def _along(line: LineString, corners: Float64Array) -> Float64Array:
    """Way along a line and offset to its left, for points (..., 2); straight on beyond its ends."""
    coords = shapely.get_coordinates(line)
    points = corners.reshape(-1, 2)
    station = shapely.line_locate_point(line, shapely.points(points))
    ways = ways_along(coords)
    leg = np.clip(np.searchsorted(ways, station, side="right") - 1, 0, len(coords) - 2)
    start = coords[leg]
    dx, dy = ((coords[leg + 1] - start) / (ways[leg + 1] - ways[leg])[:, None]).T
    ahead, left = (points - start).T
    uv = np.column_stack([ways[leg] + dx * ahead + dy * left, dx * left - dy * ahead])
    return uv.reshape(corners.shape)


def _normals(positions: Float64Array, triangles: UInt32Array) -> Float32Array:
    """Normals weighted by area: large faces stay flat, a bevel between them turns from one to the other."""
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    summed = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(summed, triangles[:, corner], normal)
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0])
    return np.where(length > 1e-12, summed / np.maximum(length, 1e-12), up).astype(np.float32)
