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
from pavetwin.scene.meshes import anticlockwise, bounds, corners_of, merged, merged_pieces, normals_of, upward_normals
from pavetwin.scene.scene import Scene
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
    tile_at,
    tile_bounds,
    tile_origin,
)
from pavetwin.scene.web.packing import DEFECT_TEXEL_M, DEFECTS_A_PART, PackedFile, WebLevel
from pavetwin.world.model import Defect

DEFECT_SHADE: Final = 0.62
"""Mean reflectance of a defect over that of the road, where an image of the ground stands for its relief."""

_FINER: Final = 4  # Samples along a texel for the outlines of defects


def ground_image(scene: Scene, key: TileKey, maps: MapPyramids, texel_m: float) -> UInt8Array:
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
    corners = anticlockwise(corners_of(shapely.constrained_delaunay_triangles(inside)))
    if not len(corners):
        return None
    flat, indices = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    positions = np.column_stack([flat - tile_bounds(key)[:2], scene.heights(flat)])
    return Mesh(
        positions.astype(np.float32), upward_normals(len(flat)), np.asarray(indices, dtype=np.uint32).reshape(-1, 3)
    )


def _over_ground(mesh: Mesh) -> Float32Array:
    """(n, 2): where the vertices of a tile's ground lie in its image."""
    return np.stack([mesh.positions[:, 0] / TILE_M, 1 - mesh.positions[:, 1] / TILE_M], axis=1)


def _middle(key: TileKey) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """The middle of a tile in its frame and in the world's."""
    x, y = tile_origin(key)
    return (TILE_M / 2, TILE_M / 2, 0.0), (x + TILE_M / 2, y + TILE_M / 2, 0.0)


def ground_colours(pieces: Sequence[GroundPiece]) -> FloatArray:
    """(n, 3) linear: the mean colour of each piece at its vertices, all pieces in a row."""
    rows = []
    for piece in pieces:
        finish = piece.finish
        colour = mean_reflectance(piece.kind) * finish.tone * np.array([finish.red, 1.0, finish.blue])
        rows.append(np.tile(colour, (len(piece.mesh.positions), 1)))
    return np.concatenate(rows)


def layers_of(pieces: Sequence[FacadePiece]) -> UInt8Array:
    """(n,) the texture of each vertex, 1 for the first, 0 for none."""
    counts = [len(piece.mesh.positions) for piece in pieces]
    return np.repeat([piece.layer + 1 for piece in pieces], counts).astype(np.uint8)


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

_GAP_PX: Final = 4  # Between the images of two defects


class TileFiles:
    """Makes the files of a scene's tiles."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._maps = lru_cache(MAPS_KEPT)(lambda key: MapPyramids.of(scene.maps(key)))
        self._heads: dict[TileKey, list[Instance]] = {}
        for head in scene.agents(None, 0.0):
            self._heads.setdefault(tile_at(*head.transform[:2, 3]), []).append(head)

    def tile(self, level: WebLevel, key: TileKey) -> bytes:
        """A tile as a gzipped file: one of its level's squares, by column and row."""
        return self._coarse(level, key) if level.texel_m is None else self._with_image(level, key, level.texel_m)

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
            origin, maps = tile_origin(key), self._maps(key)
            image, boxes = _stacked([bake_patch(patch, origin, maps, DEFECT_TEXEL_M).colour for patch in patches])
            mesh = merged([_in_tile(patch, origin) for patch in patches])
            uv = np.concatenate([_over(patch.coarse, box) for patch, box in zip(patches, boxes, strict=True)])
            which = np.repeat(np.arange(len(patches)), [len(patch.coarse.positions) for patch in patches])
            coded = jpeg(image, JPEG_QUALITY, "4:2:0")
            file.add("defects", mesh, *_middle(key), uv=uv, layers=which.astype(np.uint8), image=coded)
        labels = [labelled_defect(patch.label) for patch in patches]
        return file.packed({"tile": list(key), "part": part, "defects": labels})

    def _with_image(self, level: WebLevel, key: TileKey, texel_m: float) -> bytes:
        """A tile whose ground has an image."""
        scene, file = self._scene, PackedFile()
        centre, place = _middle(key)
        finest = scene.tile(key) if level.number == 0 else None
        pieces = scene.level_ground(key) if finest is None else finest.ground
        ground = merged_pieces(pieces)
        if ground is not None:
            image = jpeg(ground_image(scene, key, self._maps(key), texel_m), JPEG_QUALITY, "4:2:0")
            file.add("ground", ground, centre, place, uv=_over_ground(ground), image=image)
        filled = None if finest is None else fills(scene, key)
        if filled is not None:
            file.add("fills", filled, centre, place, uv=_over_ground(filled))
        facades = scene.houses_on(key, level.houses) if finest is None else finest.facades
        houses = merged_pieces(facades)
        if houses is not None:
            half = round(float(houses.positions[:, 2].max()) / 2)
            spots = (*centre[:2], half), (*place[:2], half)
            file.add("houses", houses, *spots, colours=houses.colours, facade_uv=houses.uv, layers=layers_of(facades))
        return self._packed(file, level, key, self._standing(key), self._outlines(key) if level.number == 0 else [])

    def _packed(
        self, file: PackedFile, level: WebLevel, key: TileKey, standing: Sequence[Instance], outlines: list[Any]
    ) -> bytes:
        instances = placed(standing, self._scene.models, level.smallest_m)
        return file.packed({"level": level.number, "tile": list(key), "instances": instances, "defects": outlines})

    def _coarse(self, level: WebLevel, key: TileKey) -> bytes:
        """A square of several tiles as one mesh with a colour at each vertex."""
        scene, file = self._scene, PackedFile()
        meshes, colours, layers = [], [], []
        instances: list[Instance] = []
        column, row = key[0] * level.side, key[1] * level.side
        for each in [(column + east, row + north) for north in range(level.side) for east in range(level.side)]:
            pieces, facades = scene.level_ground(each), scene.houses_on(each, level.houses)
            move = (each[0] - column) * TILE_M, (each[1] - row) * TILE_M
            ground, houses = merged_pieces(pieces), merged_pieces(facades)
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
            place = column * TILE_M + half, row * TILE_M + half, 0.0
            colour, layer = np.concatenate(colours), np.concatenate(layers)
            file.add("town", merged(meshes), (half, half, 0.0), place, colours=colour, layers=layer)
        return self._packed(file, level, key, instances, [])

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
    return Mesh(moved.astype(np.float32), normals_of(moved, mesh.indices), mesh.indices)


def _stacked(images: Sequence[UInt8Array]) -> tuple[UInt8Array, list[tuple[float, float, float, float]]]:
    """Images below each other in one, and of each its left, top, width and height in shares of it."""
    wide = max(image.shape[1] for image in images)
    tall = sum(image.shape[0] for image in images) + _GAP_PX * (len(images) - 1)
    scale = min(1.0, 2048 / max(wide, tall))
    sheet = Image.new("RGB", (wide, tall))
    boxes, top = [], 0
    for image in images:
        padded = np.pad(image, ((0, 0), (0, wide - image.shape[1]), (0, 0)), mode="edge")
        below = np.repeat(padded[-1:], _GAP_PX, axis=0)
        sheet.paste(Image.fromarray(np.concatenate([padded, below])), (0, top))
        boxes.append((0.0, top / tall, image.shape[1] / wide, image.shape[0] / tall))
        top += image.shape[0] + _GAP_PX
    if scale < 1:
        sheet = sheet.resize((max(1, round(wide * scale)), max(1, round(tall * scale))), Image.Resampling.BOX)
    return np.asarray(sheet), boxes


def _over(mesh: Mesh, box: tuple[float, float, float, float]) -> Any:
    """(n, 2) of a patch's vertices in the sheet."""
    assert mesh.uv is not None
    left, top, wide, tall = box
    return np.stack([left + wide * mesh.uv[:, 0], top + tall * (1 - mesh.uv[:, 1])], axis=1)
