"""Parts of a scene in a binary glTF file: geometry of each tile, as meshes, materials and nodes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from PIL import Image

from pavetwin.arrays import Float64Array, FloatArray, UInt8Array, UInt32Array
from pavetwin.errors import PaveTwinError
from pavetwin.plugins import load_plugins
from pavetwin.scene.buildings import FACADE_REPEAT_M, FacadeTexture
from pavetwin.scene.export.baking import BakedTexture, bake_patch, bake_tile, jpeg, png
from pavetwin.scene.export.detail import PATCH_FINER, LevelOfDetail
from pavetwin.scene.export.glb_models import SharedModels, attributes_of, indices_of
from pavetwin.scene.glb import TO_FILE, GlbWriter
from pavetwin.scene.ground.materials.compose import MapPyramids
from pavetwin.scene.meshes import merged
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import TILE_M, Instance, Mesh, Model, Tile, TileKey, labelled_defect
from pavetwin.workers import OnTick, WorkerPool
from pavetwin.world.model import Defect, World

RUN: Final = 6  # Neighbouring tiles that a process makes in one task: they share patches at their borders


@dataclass(frozen=True)
class SurfaceImages:
    """A surface's images as JPEG files."""

    colour: bytes
    normal: bytes | None


@dataclass(frozen=True)
class PatchPiece:
    """A defect's patch, or the part of it that lies on one tile."""

    label: int
    mesh: Mesh
    transform: Float64Array  # (4, 4) from the defect's frame to the world's
    images: SurfaceImages


@dataclass(frozen=True)
class TilePiece:
    """One tile."""

    tile: Tile
    ground: SurfaceImages
    patches: tuple[PatchPiece, ...]


@dataclass(frozen=True)
class Job:
    """Settings that every process needs."""

    texel_m: float
    level: LevelOfDetail
    plugins: tuple[str, ...] = ()
    """Files that register the world's classes of defects."""


def make_pieces(
    scene: Scene, keys: Sequence[TileKey], job: Job, jobs: int, write: Callable[[TilePiece], None], on_tile: OnTick
) -> None:
    """Make all tiles with `jobs` processes, and hand them to `write` in the order of `keys`.

    Raises:
        PaveTwinError: a process dies several times.
    """
    if jobs == 1:
        for key in keys:
            write(_piece(scene, key, job))
            on_tile()
        return
    runs = [tuple(keys[first : first + RUN]) for first in range(0, len(keys), RUN)]
    made: dict[tuple[TileKey, ...], list[TilePiece]] = {}
    waiting = iter([*runs, ()])
    due = next(waiting)

    def on_result(run: tuple[TileKey, ...], pieces: list[TilePiece]) -> None:
        nonlocal due
        made[run] = pieces
        while due in made:
            for piece in made.pop(due):
                write(piece)
            due = next(waiting)

    with WorkerPool(jobs, partial(_start, scene.world, scene.seed, scene.style, job), on_tile) as pool:
        pool.run(runs, on_result, give_up=_give_up)


def _start(
    world: World, seed: int, style: str, job: Job, on_tile: OnTick
) -> Callable[[tuple[TileKey, ...]], list[TilePiece]]:
    """In a worker process."""
    load_plugins(job.plugins)
    scene = Scene(world, seed=seed, style=style)

    def made(run: tuple[TileKey, ...]) -> list[TilePiece]:
        pieces = []
        for key in run:
            pieces.append(_piece(scene, key, job))
            on_tile()
        return pieces

    return made


def _give_up(run: tuple[TileKey, ...]) -> None:
    raise PaveTwinError(
        f"Processes that made the tiles from {run[0]} on died several times, perhaps for lack of memory; give fewer "
        "`jobs`."
    )


def _piece(scene: Scene, key: TileKey, job: Job) -> TilePiece:
    tile, maps, level = scene.tile(key), MapPyramids.of(scene.maps(key)), job.level
    patches = tuple(
        PatchPiece(
            patch.label,
            patch.mesh if level.has_fine_defects else patch.coarse,
            patch.transform,
            _images(bake_patch(patch, tile.origin, maps, job.texel_m * PATCH_FINER), level),
        )
        for patch in scene.patches_on(key)
    )
    return TilePiece(tile, _images(bake_tile(tile, maps, job.texel_m), level), patches)


def _images(baked: BakedTexture, level: LevelOfDetail) -> SurfaceImages:
    normal = jpeg(baked.normal, level.quality + 2, level.subsampling) if level.has_normals else None
    return SurfaceImages(jpeg(baked.colour, level.quality, level.subsampling), normal)


_ROUGH_GROUND: Final = 0.92
_GLASSY: Final = frozenset({FacadeTexture.WINDOWS, FacadeTexture.GLAZING, FacadeTexture.DOORS})


@dataclass
class SceneWriter:
    """Writes the parts of a scene into a glTF file; shared meshes, textures and materials are written once."""

    writer: GlbWriter
    models: Mapping[str, Model]
    facade_textures: UInt8Array
    centre: tuple[float, float]
    """World coordinates of the file's origin, which keeps its numbers small."""
    defects: Sequence[Defect]
    """The world's, by number."""
    _shared: SharedModels = field(init=False)
    _layers: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._shared = SharedModels(self.writer, self.models)

    def tile(self, piece: TilePiece) -> int:
        """A node with the ground, patches, buildings and instances of a tile."""
        tile = piece.tile
        children = [self._ground(tile, piece.ground)]
        children += [self._patch(patch) for patch in piece.patches]
        children += self._facades(tile)
        children += [self.instance(instance) for instance in tile.instances]
        return self.writer.node(name=f"tile {tile.key[0]} {tile.key[1]}", children=children)

    def _patch(self, patch: PatchPiece) -> int:
        if patch.mesh.uv is None:
            raise ValueError(f"the patch of defect {patch.label} has no uv")
        number = labelled_defect(patch.label)
        assert number is not None
        name = f"defect {number}"
        mesh = self._seen_from_above(name, patch.mesh, patch.mesh.uv * (1, -1) + (0, 1), patch.images)
        extras = {"label": patch.label} | self.defects[number].facts
        return self.writer.node(name=name, mesh=mesh, matrix=self._matrix(patch.transform), extras=extras)

    def instance(self, instance: Instance) -> int:
        """The node of an instance; its mesh is shared with all instances of the same appearance."""
        mesh = self._shared.mesh(instance)
        values: dict[str, Any] = {"extras": {"label": instance.label}} if instance.label else {}
        matrix = self._matrix(instance.transform)
        return self.writer.node(name=f"{instance.model} {instance.part}", mesh=mesh, matrix=matrix, **values)

    def _ground(self, tile: Tile, images: SurfaceImages) -> int:
        mesh = merged([piece.mesh for piece in tile.ground])
        uv = np.stack([mesh.positions[:, 0] / TILE_M, 1 - mesh.positions[:, 1] / TILE_M], axis=1)
        name = f"ground {tile.key[0]} {tile.key[1]}"
        index = self._seen_from_above(name, mesh, uv, images)
        return self.writer.node(name=name, mesh=index, translation=self._place(*tile.origin))

    def _facades(self, tile: Tile) -> list[int]:
        """One mesh a texture layer, for all buildings of the tile."""
        layers = sorted({piece.layer for piece in tile.facades})
        primitives = []
        for layer in layers:
            mesh = merged([piece.mesh for piece in tile.facades if piece.layer == layer])
            uv = mesh.uv * (1, -1) / FACADE_REPEAT_M + (0, 1) if layer >= 0 and mesh.uv is not None else None
            attributes = attributes_of(self.writer, mesh, uv=uv, colours=mesh.colours)
            primitives.append(self._primitive(attributes, mesh.indices, self._facade_material(layer)))
        if not primitives:
            return []
        name = f"buildings {tile.key[0]} {tile.key[1]}"
        mesh_index = self.writer.mesh(name, primitives)
        return [self.writer.node(name=name, mesh=mesh_index, translation=self._place(*tile.origin))]

    def _facade_material(self, layer: int) -> int:
        if layer not in self._layers:
            values: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
            if layer >= 0:
                texture = self.facade_textures[layer, ::-1]
                values["baseColorTexture"] = {"index": self.writer.texture(jpeg(texture[..., :3], 90), "image/jpeg")}
                if layer in _GLASSY:
                    values["roughnessFactor"] = 1.0
                    rough = self.writer.texture(_roughness(texture), "image/png")
                    values["metallicRoughnessTexture"] = {"index": rough}
            name = FacadeTexture(layer).name.lower()
            self._layers[layer] = self.writer.material(name=f"facade {name}", pbrMetallicRoughness=values)
        return self._layers[layer]

    def _seen_from_above(self, name: str, mesh: Mesh, uv: FloatArray, images: SurfaceImages) -> int:
        """A mesh with an image of it from above."""
        values: dict[str, Any] = {}
        if images.normal is not None:
            normal = self.writer.texture(images.normal, "image/jpeg", clamped=True)
            values["normalTexture"] = {"index": normal}
        pbr: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": _ROUGH_GROUND}
        pbr["baseColorTexture"] = {"index": self.writer.texture(images.colour, "image/jpeg", clamped=True)}
        material = self.writer.material(name=name, pbrMetallicRoughness=pbr, **values)
        attributes = attributes_of(self.writer, mesh, uv=uv, has_tangents=images.normal is not None)
        return self.writer.mesh(name, [self._primitive(attributes, mesh.indices, material)])

    def _primitive(self, attributes: dict[str, int], indices: UInt32Array, material: int) -> dict[str, Any]:
        return {"attributes": attributes, "indices": indices_of(self.writer, indices), "material": material}

    def _place(self, x_m: float, y_m: float) -> list[float]:
        """A world position on the ground in the file's axes."""
        return [y_m - self.centre[1], 0.0, x_m - self.centre[0]]

    def _matrix(self, transform: Float64Array) -> list[float]:
        """A transform of ours as the file has it: in its axes, column by column."""
        moved = transform.copy()
        moved[:2, 3] -= self.centre
        values: list[float] = np.round(TO_FILE @ moved @ TO_FILE.T, 7).T.reshape(-1).tolist()
        return values


def _roughness(texture: UInt8Array) -> bytes:
    """A PNG whose green channel is the roughness, as glTF has it."""
    pixels = np.zeros(texture[..., :3].shape, dtype=np.uint8)
    pixels[..., 1] = texture[..., 3]
    return png(Image.fromarray(pixels))
