"""The parts of a scene as meshes, materials and nodes of a binary glTF file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Final

import numpy as np
from PIL import Image

from pavetwin.arrays import Float64Array, FloatArray, UInt8Array, UInt32Array
from pavetwin.scene.buildings import FACADE_REPEAT_M, FacadeTexture
from pavetwin.scene.export.baking import QUALITY_COLOUR, QUALITY_NORMAL, BakedTexture, bake_patch, bake_tile, jpeg
from pavetwin.scene.export.shared import SharedModels, attributes_of, indices_of
from pavetwin.scene.glb import TO_FILE, GlbWriter
from pavetwin.scene.ground.compose import MapPyramids
from pavetwin.scene.model import TILE_M, DefectPatch, GroundMaps, Instance, Mesh, Model, Tile, labelled_defect
from pavetwin.scene.models import merged
from pavetwin.world.model import Defect

PATCH_FINER: Final = 0.25
"""Texels of defects are this share of the ground's, down to those of their maps."""

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

    def tile(self, tile: Tile, maps: GroundMaps, patches: Sequence[DefectPatch], texel_m: float) -> int:
        """A node with the ground, patches, buildings and instances of a tile."""
        levels = MapPyramids.of(maps)
        children = [self._ground(tile, bake_tile(tile, levels, texel_m))]
        pictures = (bake_patch(patch, tile.origin, levels, texel_m * PATCH_FINER) for patch in patches)
        children += [self._patch(patch, picture) for patch, picture in zip(patches, pictures, strict=True)]
        children += self._facades(tile)
        children += [self.instance(instance) for instance in tile.instances]
        return self.writer.node(name=f"tile {tile.key[0]} {tile.key[1]}", children=children)

    def _patch(self, patch: DefectPatch, picture: BakedTexture) -> int:
        """The node of a defect's patch, or of the part of it that lies on one tile."""
        if patch.mesh.uv is None:
            raise ValueError(f"the patch of defect {patch.label} has no uv")
        number = labelled_defect(patch.label)
        assert number is not None
        name = f"defect {number}"
        attributes = attributes_of(self.writer, patch.mesh, uv=patch.mesh.uv * (1, -1) + (0, 1), seen_from_above=True)
        mesh = self._mesh(name, attributes, patch.mesh.indices, self._pictured(picture, name))
        extras = {"label": patch.label} | self.defects[number].facts
        return self.writer.node(name=name, mesh=mesh, matrix=self._matrix(patch.transform), extras=extras)

    def instance(self, instance: Instance) -> int:
        """The node of an instance; its mesh is shared with all instances of the same appearance."""
        mesh = self._shared.mesh(instance)
        extras = {"label": instance.label} if instance.label else {}
        values: dict[str, Any] = {"extras": extras} if extras else {}
        matrix = self._matrix(instance.transform)
        return self.writer.node(name=f"{instance.model} {instance.part}", mesh=mesh, matrix=matrix, **values)

    def _ground(self, tile: Tile, picture: BakedTexture) -> int:
        mesh = merged([piece.mesh for piece in tile.ground])
        uv = np.stack([mesh.positions[:, 0] / TILE_M, 1 - mesh.positions[:, 1] / TILE_M], axis=1)
        name = f"ground {tile.key[0]} {tile.key[1]}"
        material = self._pictured(picture, name)
        index = self._mesh(name, attributes_of(self.writer, mesh, uv=uv, seen_from_above=True), mesh.indices, material)
        return self.writer.node(name=name, mesh=index, translation=self._place(*tile.origin))

    def _facades(self, tile: Tile) -> list[int]:
        """One mesh a texture layer, for all buildings of the tile."""
        layers = sorted({piece.layer for piece in tile.facades})
        primitives = []
        for layer in layers:
            mesh = merged([piece.mesh for piece in tile.facades if piece.layer == layer])
            attributes = attributes_of(
                self.writer, mesh, uv=_facade_uv(mesh) if layer >= 0 else None, colours=mesh.colours
            )
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
                    values["metallicRoughnessTexture"] = {
                        "index": self.writer.texture(_roughness(texture), "image/png")
                    }
            name = FacadeTexture(layer).name.lower()
            self._layers[layer] = self.writer.material(name=f"facade {name}", pbrMetallicRoughness=values)
        return self._layers[layer]

    def _pictured(self, picture: BakedTexture, name: str) -> int:
        """A material from a picture."""
        colour = self.writer.texture(jpeg(picture.colour, QUALITY_COLOUR), "image/jpeg", clamped=True)
        normal = self.writer.texture(jpeg(picture.normal, QUALITY_NORMAL), "image/jpeg", clamped=True)
        return self.writer.material(
            name=name,
            pbrMetallicRoughness={
                "baseColorTexture": {"index": colour},
                "metallicFactor": 0.0,
                "roughnessFactor": _ROUGH_GROUND,
            },
            normalTexture={"index": normal},
        )

    def _mesh(self, name: str, attributes: dict[str, int], indices: UInt32Array, material: int) -> int:
        return self.writer.mesh(name, [self._primitive(attributes, indices, material)])

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


def _facade_uv(mesh: Mesh) -> FloatArray:
    if mesh.uv is None:
        raise ValueError("a façade has no uv")
    return mesh.uv * (1, -1) / FACADE_REPEAT_M + (0, 1)


def _roughness(texture: UInt8Array) -> bytes:
    """A PNG whose green channel is the roughness, as glTF has it."""
    pixels = np.zeros_like(texture[..., :3])
    pixels[..., 1] = texture[..., 3]
    stream = BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(stream, "PNG", optimize=True)
    return stream.getvalue()
