"""Files of a town for browsers: tiles of each level of detail, and the relief of defects."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import Float32Array, FloatArray, UInt8Array
from pavetwin.scene.export.baking import bake_patch, bake_tile, jpeg
from pavetwin.scene.glb import TO_FILE
from pavetwin.scene.ground.materials.compose import MapPyramids, mean_reflectance
from pavetwin.scene.models import bounds, merged
from pavetwin.scene.scene import Scene, tile_bounds
from pavetwin.scene.values import (
    TILE_M,
    DefectPatch,
    FacadePiece,
    GroundPiece,
    Instance,
    Mesh,
    Model,
    Tile,
    TileKey,
    labelled_defect,
)
from pavetwin.scene.web.packing import DEFECT_TEXEL_M, DEFECTS_A_PART, PackedFile, WebLevel
from pavetwin.world.model import Defect

DEFECT_SHADE: Final = 0.62
"""Mean reflectance of a defect over that of the road, where a image of the ground stands for its relief."""

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
    """(n, 2): where the vertices of a tile's ground lie in its image."""
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


JPEG_QUALITY: Final = 78
MAPS_KEPT: Final = 4
"""A tile's levels and defects share its maps."""

_GAP_PX: Final = 4
"""Between the images of two defects."""


class TileFiles:
    """Makes the files of a scene's tiles."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._maps = lru_cache(MAPS_KEPT)(lambda key: MapPyramids.of(scene.maps(key)))
        self._heads: dict[TileKey, list[Instance]] = {}
        for head in scene.agents(None, 0.0):
            column, row = (int(np.floor(head.transform[axis, 3] / TILE_M)) for axis in (0, 1))
            self._heads.setdefault((column, row), []).append(head)

    def tile(self, level: WebLevel, key: TileKey) -> bytes:
        """A tile as a gzipped file: one of its level's squares, by column and row."""
        return self._coarse(level, key) if level.texel_m is None else self._pictured(level, key, level.texel_m)

    def parts(self, key: TileKey) -> int:
        """Number of files that hold the relief of a tile's defects."""
        return -(-len(self._scene.holes_on(key)) // DEFECTS_A_PART)

    def relief(self, key: TileKey, part: int) -> bytes:
        """Some of a tile's defects as a gzipped file."""
        numbers = list(self._scene.holes_on(key))[part * DEFECTS_A_PART : (part + 1) * DEFECTS_A_PART]
        found = [self._scene.patch_on(key, number) for number in numbers]
        patches = [patch for patch in found if patch is not None]
        file = PackedFile()
        if patches:
            origin = key[0] * TILE_M, key[1] * TILE_M
            maps = self._maps(key)
            pictures = [bake_patch(patch, origin, maps, DEFECT_TEXEL_M).colour for patch in patches]
            picture, boxes = _stacked(pictures)
            mesh = merged([_in_tile(patch, origin) for patch in patches])
            uv = np.concatenate([_over(patch.coarse, box) for patch, box in zip(patches, boxes, strict=True)])
            centre = TILE_M / 2, TILE_M / 2, 0.0
            place = origin[0] + centre[0], origin[1] + centre[1], 0.0
            which = np.repeat(np.arange(len(patches)), [len(patch.coarse.positions) for patch in patches])
            coded = jpeg(picture, JPEG_QUALITY, "4:2:0")
            file.add("defects", mesh, centre, place, uv=uv, layers=which.astype(np.uint8), picture=coded)
        labels = [labelled_defect(patch.label) for patch in patches]
        return file.packed({"tile": list(key), "part": part, "defects": labels})

    def _pictured(self, level: WebLevel, key: TileKey, texel_m: float) -> bytes:
        """A tile whose ground has a image."""
        scene, file = self._scene, PackedFile()
        origin = key[0] * TILE_M, key[1] * TILE_M
        centre = TILE_M / 2, TILE_M / 2, 0.0
        place = origin[0] + centre[0], origin[1] + centre[1], 0.0
        finest = scene.tile(key) if level.number == 0 else None
        pieces = scene.level_ground(key) if finest is None else finest.ground
        ground = joined(pieces)
        if ground is not None:
            picture = jpeg(ground_picture(scene, key, self._maps(key), texel_m), JPEG_QUALITY, "4:2:0")
            file.add("ground", ground, centre, place, uv=over_picture(ground), picture=picture)
        filled = None if finest is None else fills(scene, key)
        if filled is not None:
            file.add("fills", filled, centre, place, uv=over_picture(filled))
        facades = scene.houses_on(key, level.houses) if finest is None else finest.facades
        houses = joined(facades)
        if houses is not None:
            half = round(float(houses.positions[:, 2].max()) / 2)
            file.add(
                "houses",
                houses,
                (*centre[:2], half),
                (*place[:2], half),
                colours=houses.colours,
                facade_uv=houses.uv,
                layers=layers_of(facades),
            )
        return file.packed(
            {
                "level": level.number,
                "tile": list(key),
                "instances": placed(self._standing(key), scene.models, level.smallest_m),
                "defects": self._outlines(key) if level.number == 0 else [],
            }
        )

    def _coarse(self, level: WebLevel, key: TileKey) -> bytes:
        """A square of several tiles as one mesh with a colour at each vertex."""
        scene, file = self._scene, PackedFile()
        meshes, colours, layers = [], [], []
        instances: list[Instance] = []
        column, row = key[0] * level.side, key[1] * level.side
        for each in [(column + east, row + north) for north in range(level.side) for east in range(level.side)]:
            pieces, facades = scene.level_ground(each), scene.houses_on(each, level.houses)
            move = (each[0] - column) * TILE_M, (each[1] - row) * TILE_M
            ground, houses = joined(pieces), joined(facades)
            if ground is not None:
                meshes.append(shifted(_bare(ground), *move))
                colours.append(ground_colours(pieces))
                layers.append(np.zeros(len(ground.positions), dtype=np.uint8))
            if houses is not None:
                assert houses.colours is not None
                meshes.append(shifted(_bare(houses), *move))
                colours.append(houses.colours)
                layers.append(layers_of(facades))
            instances += self._standing(each)
        if meshes:
            half = level.side_m / 2
            file.add(
                "town",
                merged(meshes),
                (half, half, 0.0),
                (column * TILE_M + half, row * TILE_M + half, 0.0),
                colours=np.concatenate(colours),
                layers=np.concatenate(layers),
            )
        return file.packed(
            {
                "level": level.number,
                "tile": list(key),
                "instances": placed(instances, scene.models, level.smallest_m),
                "defects": [],
            }
        )

    def _standing(self, key: TileKey) -> Sequence[Instance]:
        return (*self._scene.standing_on(key), *self._heads.get(key, ()))

    def _outlines(self, key: TileKey) -> list[dict[str, Any]]:
        """The defects of a tile, with their outlines to 5 cm in the world frame."""
        found = []
        for number in self._scene.holes_on(key):
            defect = self._scene.world.defects[number]
            ring = shapely.get_coordinates(shapely.simplify(defect.polygon, 0.05))[:-1]
            found.append({"id": defect.id, **defect.facts, "outline": np.round(ring, 2).tolist()})
        return found


def _bare(mesh: Mesh) -> Mesh:
    """Positions, normals and triangles alone, which ground and houses both have."""
    return Mesh(mesh.positions, mesh.normals, mesh.indices)


def _in_tile(patch: DefectPatch, origin: tuple[float, float]) -> Mesh:
    """The coarse mesh of a patch in a tile's frame, its normals those of its triangles."""
    mesh = patch.coarse
    moved = mesh.positions @ patch.transform[:3, :3].T + patch.transform[:3, 3] - (*origin, 0.0)
    corners = moved[mesh.indices]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    summed = np.zeros_like(moved)
    for corner in range(3):
        np.add.at(summed, mesh.indices[:, corner], faces)
    normals = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)
    return Mesh(moved.astype(np.float32), normals.astype(np.float32), mesh.indices)


def _stacked(pictures: Sequence[UInt8Array]) -> tuple[UInt8Array, list[tuple[float, float, float, float]]]:
    """Images below each other in one, and of each its left, top, width and height in shares of it."""
    wide = max(picture.shape[1] for picture in pictures)
    tall = sum(picture.shape[0] for picture in pictures) + _GAP_PX * (len(pictures) - 1)
    most = max(wide, tall)
    scale = min(1.0, 2048 / most)
    sheet = Image.new("RGB", (wide, tall))
    boxes, top = [], 0
    for picture in pictures:
        padded = np.pad(picture, ((0, 0), (0, wide - picture.shape[1]), (0, 0)), mode="edge")
        below = np.repeat(padded[-1:], _GAP_PX, axis=0)
        sheet.paste(Image.fromarray(np.concatenate([padded, below])), (0, top))
        boxes.append((0.0, top / tall, picture.shape[1] / wide, picture.shape[0] / tall))
        top += picture.shape[0] + _GAP_PX
    if scale < 1:
        sheet = sheet.resize((max(1, round(wide * scale)), max(1, round(tall * scale))), Image.Resampling.BOX)
    return np.asarray(sheet), boxes


def _over(mesh: Mesh, box: tuple[float, float, float, float]) -> Any:
    """(n, 2) of a patch's vertices in the sheet."""
    assert mesh.uv is not None
    left, top, wide, tall = box
    return np.stack([left + wide * mesh.uv[:, 0], top + tall * (1 - mesh.uv[:, 1])], axis=1)
