"""What a tile for browsers shows: its ground, houses and standing objects, at a level of detail."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import Float32Array, FloatArray, UInt8Array
from pavetwin.scene.export.baking import bake_tile
from pavetwin.scene.glb import TO_FILE
from pavetwin.scene.ground.materials.compose import MapPyramids, mean_reflectance
from pavetwin.scene.model import TILE_M, FacadePiece, GroundPiece, Instance, Mesh, Model, Tile, TileKey
from pavetwin.scene.models import bounds, merged
from pavetwin.scene.scene import Scene, tile_bounds
from pavetwin.world.model import Defect

DEFECT_SHADE: Final = 0.62
"""Mean reflectance of a defect over that of the road, where a picture of the ground stands for its relief."""

_FINER: Final = 4
"""Samples along a texel for the outlines of defects."""


def ground_picture(scene: Scene, key: TileKey, maps: MapPyramids, texel_m: float) -> UInt8Array:
    """(k, k, 3) sRGB: a tile's ground from above, north at the top, with its defects as darker outlines."""
    whole = Tile(key, scene.level_ground(key), (), ())
    colour = bake_tile(whole, maps, texel_m).colour
    defects = [scene.world.defects[number] for number in scene.holes_on(key)]
    return _darkened(colour, defects, tile_bounds(key)[:2]) if defects else colour


def _darkened(colour: UInt8Array, defects: Sequence[Defect], origin: tuple[float, float]) -> UInt8Array:
    side = len(colour) * _FINER
    cover = Image.new("L", (side, side), 0)
    pen = ImageDraw.Draw(cover)
    for defect in defects:
        ring = (np.asarray(defect.polygon.exterior.coords) - origin) * (side / TILE_M)
        pen.polygon([(float(x), float(side - y)) for x, y in ring], fill=255)
    share = np.asarray(cover.resize(colour.shape[:2], Image.Resampling.BOX), dtype=np.float32)[..., None] / 255
    # In sRGB a factor on the reflectance is about its power of 1 / 2.2.
    return np.asarray(np.round(colour * (1 - share * (1 - DEFECT_SHADE ** (1 / 2.2)))), dtype=np.uint8)


def fills(scene: Scene, key: TileKey) -> Mesh | None:
    """Level ground in the holes of a tile, to be shown until the relief of its defects is there; tile's frame."""
    holes = [scene.hole(number) for number in scene.holes_on(key)]
    inside = shapely.intersection(shapely.union_all(holes), shapely.box(*tile_bounds(key)))
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(inside))
    if not len(triangles):
        return None
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    clockwise = ax * by - ay * bx < 0
    corners[clockwise] = corners[clockwise][:, ::-1]
    flat, indices = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    positions = np.column_stack([flat - tile_bounds(key)[:2], scene.heights(flat)])
    upright = np.tile(np.array([0, 0, 1], dtype=np.float32), (len(flat), 1))
    return Mesh(positions.astype(np.float32), upright, np.asarray(indices, dtype=np.uint32).reshape(-1, 3))


def over_picture(mesh: Mesh) -> Float32Array:
    """(n, 2): where the vertices of a tile's ground lie in its picture."""
    x, y = mesh.positions[:, 0] / TILE_M, 1 - mesh.positions[:, 1] / TILE_M
    return np.stack([x, y], axis=1)


def ground_colours(pieces: Sequence[GroundPiece]) -> FloatArray:
    """(n, 3) linear: the mean colour of each piece at its vertices, all pieces in a row."""
    rows = []
    for piece in pieces:
        finish = piece.finish
        colour = mean_reflectance(piece.kind) * finish.tone * np.array([finish.red, 1.0, finish.blue])
        rows.append(np.tile(colour, (len(piece.mesh.positions), 1)))
    return np.concatenate(rows)


def joined(pieces: Sequence[GroundPiece | FacadePiece]) -> Mesh | None:
    """The meshes of some pieces as one; None if there is no triangle."""
    return merged([piece.mesh for piece in pieces]) if any(len(piece.mesh.indices) for piece in pieces) else None


def layers_of(pieces: Sequence[FacadePiece]) -> UInt8Array:
    """(n,) the texture of each vertex, 1 for the first, 0 for none."""
    return np.repeat([piece.layer + 1 for piece in pieces], [len(piece.mesh.positions) for piece in pieces]).astype(
        np.uint8
    )


def shifted(mesh: Mesh, x_m: float, y_m: float) -> Mesh:
    """A mesh moved along the ground."""
    return replace(mesh, positions=(mesh.positions + np.array([x_m, y_m, 0.0])).astype(np.float32))


def placed(instances: Iterable[Instance], models: Mapping[str, Model], smallest_m: float) -> dict[str, list[Any]]:
    """Instances by the name of their model's part, a row of numbers each.

    A row has the twelve numbers of its matrix in the file's axes, column by column, then red, green, blue of the slots
    1 … n that the part has; a part without slots has twelve.
    """
    found: dict[str, list[Any]] = {}
    for instance in instances:
        mesh = models[instance.model].parts[instance.part]
        low, high = bounds(mesh)
        stretch = np.linalg.norm(instance.transform[:3, :3], axis=0)
        if sorted((high - low) * stretch)[1] < smallest_m:
            continue
        matrix = (TO_FILE @ instance.transform @ TO_FILE.T)[:3]
        slots = 0 if mesh.surface is None else int(mesh.surface[:, 2].max())
        row = [*np.round(matrix[:, :3].T.reshape(-1), 4).tolist(), *np.round(matrix[:, 3], 3).tolist()]
        row += np.round(instance.tints[:slots, :3], 2).reshape(-1).tolist()
        found.setdefault(f"{instance.model}:{instance.part}", []).append([_short(value) for value in row])
    return {name: found[name] for name in sorted(found)}


def _short(value: float) -> float | int:
    return int(value) if value == int(value) else value
