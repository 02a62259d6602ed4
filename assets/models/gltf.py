"""Writes a model as a binary glTF 2.0 file. The same model gives the same bytes.

Blender's own exporter is not used: it writes colours as 16-bit numbers or floats, and its own version.
"""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from assets.models.common import Model, Part, ambient_occlusion
from assets.models.materials import MATERIALS

FLOAT32, UINT8, UINT16 = 5126, 5121, 5123
VERTICES, INDICES = 34962, 34963
MOST_VERTICES: Final = 65535


class _Buffer:
    """The binary chunk as it grows, with its views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.known: dict[tuple[bytes, int, str], int] = {}

    def add(self, array: NDArray[Any], component: int, shape: str, target: int, **more: Any) -> int:
        """The index of an accessor over `array`: the same one for the same content, as poses share their triangles."""
        raw = np.ascontiguousarray(array).tobytes()
        key = (raw, component, shape)
        if key in self.known:
            return self.known[key]
        self.views.append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw), "target": target}
        )  # fmt: skip
        self.data += raw + b"\0" * (-len(raw) % 4)
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(array), "type": shape}
        self.accessors.append(accessor | more)
        self.known[key] = len(self.accessors) - 1
        return self.known[key]


def to_file_axes(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """From x forward, y left, z up to glTF's x left, y up, z forward."""
    return points[:, [1, 2, 0]].astype("<f4")


def glb_bytes(model: Model, ground: bool = True) -> bytes:
    """The model as a file, ambient occlusion baked into its colours (see `ambient_occlusion`)."""
    buffer = _Buffer()
    used = {name for node in model.meshes() for name in node.by_material()}
    materials = [name for name in MATERIALS if name in used]
    nodes, meshes = [], []
    for index, node in enumerate(model.meshes()):
        parts = node.by_material()
        openness = ambient_occlusion(parts.values(), node.reach_m, ground)
        primitives = [
            _primitive(buffer, one, open_, materials.index(name))
            for (name, one), open_ in zip(parts.items(), openness, strict=True)
        ]
        meshes.append({"name": node.name, "primitives": primitives})
        nodes.append({"name": node.name, "mesh": index} | ({"extras": node.extras} if node.extras else {}))
    document = {
        "asset": {"version": "2.0", "generator": "PaveTwin assets"}
        | ({"extras": model.extras} if model.nodes and model.extras else {}),
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [_material(name, model.colours.get(name, MATERIALS[name].colour)) for name in materials],
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    return _container(document, bytes(buffer.data))


def write_glb(model: Model, path: Path, ground: bool = True) -> None:
    """Writes the model to `path`, whole or not at all."""
    data = glb_bytes(model, ground)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_bytes(data)
    part.replace(path)


def _primitive(buffer: _Buffer, part: Part, openness: NDArray[np.float64], material: int) -> dict[str, Any]:
    if len(part.vertices) > MOST_VERTICES:
        raise ValueError(f"{part.material}: {len(part.vertices)} vertices, and indices of 16 bits count to 65535")
    places = to_file_axes(part.vertices)
    colours = np.full((len(places), 4), 255, dtype=np.uint8)
    colours[:, :3] = np.round(255.0 * np.clip(part.tint * openness[:, None], 0.0, 1.0))
    bounds = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    return {
        "attributes": {
            "POSITION": buffer.add(places, FLOAT32, "VEC3", VERTICES, **bounds),
            "NORMAL": buffer.add(to_file_axes(part.normals), FLOAT32, "VEC3", VERTICES),
            "COLOR_0": buffer.add(colours, UINT8, "VEC4", VERTICES, normalized=True),
        }
        | ({} if part.uv is None else {"TEXCOORD_0": buffer.add(part.uv.astype("<f4"), FLOAT32, "VEC2", VERTICES)}),
        "indices": buffer.add(part.triangles.reshape(-1).astype("<u2"), UINT16, "SCALAR", INDICES),
        "material": material,
    }


def _material(name: str, colour: tuple[float, float, float]) -> dict[str, Any]:
    material = MATERIALS[name]
    return {
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*colour, 1.0],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
    } | ({"doubleSided": True} if material.double_sided else {})


def _container(document: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    words = [len(text).to_bytes(4, "little"), b"JSON", text, len(binary).to_bytes(4, "little"), b"BIN\0", binary]
    body = b"".join(words)
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body
