"""Models in a binary glTF file: geometry written once, a mesh for every colouring, a node for every instance."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from PIL import Image

from pavetwin.arrays import BoolArray, Float32Array, FloatArray, UInt8Array, UInt32Array
from pavetwin.scene.export.baking import png
from pavetwin.scene.foliage import CUT, leaf_atlas
from pavetwin.scene.glb import INDICES, GlbWriter, to_file_axes
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.values import Instance, Mesh, Model

TINT_STEPS: Final = 64  # Colours of individuals are rounded to this many steps, so that many share a mesh


class _Group(NamedTuple):
    """The triangles of a part that share a material."""

    attributes: dict[str, int]
    indices: int
    finish: tuple[int, int, int]  # Roughness, metallic, slot
    leafy: bool  # Whether it is cut out by the leaf atlas
    colour: Float32Array  # (3,) the maximum of each channel; vertex colours are shares of it


@dataclass
class SharedModels:
    """The models written so far."""

    writer: GlbWriter
    models: Mapping[str, Model]
    _groups: dict[tuple[str, str], list[_Group]] = field(default_factory=dict)
    _meshes: dict[tuple[str, str, bytes], int] = field(default_factory=dict)
    _materials: dict[bytes, int] = field(default_factory=dict)
    _leaves: int | None = None
    """The texture of leaves, once there is any tree."""

    def mesh(self, instance: Instance) -> int:
        """The mesh of an instance, with its own colours."""
        tints = (np.round(instance.tints * TINT_STEPS) / TINT_STEPS).astype(np.float32)
        groups = self._grouped(instance.model, instance.part)
        slots = sorted({group.finish[2] for group in groups if group.finish[2]})
        key = (instance.model, instance.part, tints[[slot - 1 for slot in slots]].tobytes())
        if key not in self._meshes:
            primitives = [
                {
                    "attributes": group.attributes,
                    "indices": group.indices,
                    "material": self._material(group, tints[group.finish[2] - 1] if group.finish[2] else None),
                }
                for group in groups
            ]
            self._meshes[key] = self.writer.mesh(f"{instance.model} {instance.part}", primitives)
        return self._meshes[key]

    def _grouped(self, model: str, part: str) -> list[_Group]:
        if (model, part) not in self._groups:
            mesh = self.models[model].parts[part]
            if mesh.surface is None or mesh.colours is None:
                raise ValueError(f"the model {model} has no colours")
            finishes = mesh.surface[mesh.indices[:, 0]]
            self._groups[model, part] = [
                self._group(mesh, mesh.colours, (finishes == finish).all(axis=1), finish)
                for finish in np.unique(finishes, axis=0)
            ]
        return self._groups[model, part]

    def _group(self, mesh: Mesh, colours: Float32Array, triangles: BoolArray, finish: UInt8Array) -> _Group:
        used, indices = np.unique(mesh.indices[triangles], return_inverse=True)
        piece = Mesh(mesh.positions[used], mesh.normals[used], indices.reshape(-1, 3).astype(np.uint32))
        brightest = np.maximum(colours[used].max(axis=0), 1e-4)
        uv = None if mesh.uv is None else mesh.uv[used]
        attributes = attributes_of(self.writer, piece, uv=uv, colours=colours[used] / brightest)
        rough, metallic, slot = (int(value) for value in finish)
        indices_ = indices_of(self.writer, piece.indices)
        return _Group(attributes, indices_, (rough, metallic, slot), uv is not None, brightest)

    def _material(self, group: _Group, tint: Float32Array | None) -> int:
        colour = group.colour if tint is None else group.colour * tint[:3]
        factor = [*np.clip(colour, 0, 1).astype(float).tolist(), 1.0]
        glow = 0.0 if tint is None else float(tint[3])
        key = repr((group.finish[:2], group.leafy, factor, glow)).encode()
        if key not in self._materials:
            rough, metallic, _ = group.finish
            material: dict[str, Any] = {
                "pbrMetallicRoughness": {
                    "baseColorFactor": factor,
                    "metallicFactor": metallic / 255,
                    "roughnessFactor": rough / 255,
                },
                "doubleSided": True,
            }
            if group.leafy:
                material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": self._leaf_texture()}
                material |= {"alphaMode": "MASK", "alphaCutoff": CUT}
            if glow > 0:
                material["emissiveFactor"] = (np.clip(colour, 0, 1) / max(float(colour.max()), 1e-4)).tolist()
            self._materials[key] = self.writer.material(**material)
        return self._materials[key]

    def _leaf_texture(self) -> int:
        if self._leaves is None:
            self._leaves = self.writer.texture(png(leaves_image()), "image/png")
        return self._leaves


def leaves_image() -> Image.Image:
    """The leaf atlas, sRGB-coded, with the alpha that cuts it out; row 0 is v = 0."""
    atlas = leaf_atlas()
    coded = np.round(255 * srgb_of_linear(atlas[..., :3] / 255)).astype(np.uint8)
    return Image.fromarray(np.concatenate([coded, atlas[..., 3:]], axis=-1))


def attributes_of(
    writer: GlbWriter,
    mesh: Mesh,
    *,
    uv: FloatArray | None = None,
    colours: Float32Array | None = None,
    has_tangents: bool = False,
) -> dict[str, int]:
    """Write a mesh's vertices.

    Args:
        mesh: in our axes.
        uv: (n, 2) as glTF has it: (0, 0) is the image's upper left corner.
        colours: (n, 3) linear.
        has_tangents: for a normal map seen from above, which has x to the right and y up the image.
    """
    attributes = {
        "POSITION": writer.array(to_file_axes(mesh.positions)),
        "NORMAL": writer.array(_unit(to_file_axes(mesh.normals))),
    }
    if has_tangents:
        attributes["TANGENT"] = writer.array(_tangents(mesh.normals))
    if uv is not None:
        attributes["TEXCOORD_0"] = writer.array(uv.astype(np.float32))
    if colours is not None:
        packed = np.full((len(colours), 4), 65_535, dtype=np.uint16)
        packed[:, :3] = np.round(65_535 * np.clip(colours, 0, 1))
        attributes["COLOR_0"] = writer.array(packed, normalized=True)
    return attributes


def indices_of(writer: GlbWriter, indices: UInt32Array) -> int:
    """Write triangles (m, 3), in 16 bits where they fit."""
    flat = indices.reshape(-1)
    return writer.array(flat.astype("<u2" if flat.max(initial=0) < 65_535 else "<u4"), target=INDICES)


def _tangents(normals: Float32Array) -> Float32Array:
    """(n, 4) in the file's axes: the part of x, else of y, in the surface; the image's up is to its left."""
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    steep = np.abs(normals[:, :1]) > 0.99
    along = np.where(steep, y, x)
    along = along - normals * (along * normals).sum(axis=1, keepdims=True)
    return np.column_stack([_unit(to_file_axes(along)), np.ones(len(normals))]).astype(np.float32)


def _unit(normals: Float32Array) -> Float32Array:
    """glTF wants normals of length 1 to within rounding."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    up = np.array([0, 1, 0], dtype=np.float32)
    return np.where(length > 1e-6, normals / np.maximum(length, 1e-6), up).astype(np.float32)
