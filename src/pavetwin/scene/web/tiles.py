"""The files of a town for browsers: tiles of each level, and the relief of defects."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
import shapely
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.scene.export.baking import bake_patch, jpeg
from pavetwin.scene.ground.materials.compose import MapPyramids
from pavetwin.scene.model import TILE_M, DefectPatch, Instance, Mesh, TileKey, labelled_defect
from pavetwin.scene.models import merged
from pavetwin.scene.scene import Scene
from pavetwin.scene.web.levels import DEFECT_TEXEL_M, DEFECTS_A_PART, WebLevel
from pavetwin.scene.web.packing import PackedFile
from pavetwin.scene.web.surfaces import (
    fills,
    ground_colours,
    ground_picture,
    joined,
    layers_of,
    over_picture,
    placed,
    shifted,
)

JPEG_QUALITY: Final = 78
MAPS_KEPT: Final = 4
"""A tile's levels and defects share its maps."""

_GAP_PX: Final = 4
"""Between the pictures of two defects."""


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
        """A tile whose ground has a picture."""
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
    """Pictures below each other in one, and of each its left, top, width and height in shares of it."""
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
