"""Binary glTF 2.0: reading the meshes of a small file, and writing one of any size piece by piece.

Axes: the file has y up and a model looks along +z; ours are x forward, y left, z up. Ours = (z, x, y) of the file.

Written here because no library fits: trimesh takes a second to import and allows a material or vertex colours but not
both, pygltflib has no types and would keep all images of a town in memory. Tests read with trimesh.
"""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from pavetwin.arrays import AnyArray, Float32Array

MAGIC: Final = b"glTF"
_JSON, _BIN = b"JSON", b"BIN\0"
_COMPONENTS: Final[Mapping[int, str]] = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_NUMBERS: Final[Mapping[str, int]] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_SHAPE_OF: Final[Mapping[int, str]] = {width: shape for shape, width in _NUMBERS.items()}
VERTICES, INDICES = 34962, 34963
LINEAR, LINEAR_MIPMAP_LINEAR, REPEAT, CLAMP_TO_EDGE = 9729, 9987, 10497, 33071
LARGEST: Final = 2**32 - 1
"""A glb counts its bytes with 32 bits."""

TO_FILE: Final = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""(4, 4) from our axes to the file's."""


def to_file_axes(vectors: AnyArray) -> Float32Array:
    """Ours (n, 3) to the file's."""
    return np.ascontiguousarray(vectors[:, [1, 2, 0]], dtype=np.float32)


def from_file_axes(vectors: AnyArray) -> Float32Array:
    """The file's (n, 3) to ours."""
    return np.ascontiguousarray(vectors[:, [2, 0, 1]], dtype=np.float32)


class Glb:
    """A file that has been read: its document, and its accessors as arrays."""

    def __init__(self, data: bytes) -> None:
        """Raises ValueError where this is not a binary glTF 2."""
        if data[:4] != MAGIC or int.from_bytes(data[4:8], "little") != 2 or data[16:20] != _JSON:
            raise ValueError("no binary glTF 2.0 file")
        size = int.from_bytes(data[12:16], "little")
        self.document: dict[str, Any] = json.loads(data[20 : 20 + size])
        self._binary = memoryview(data)[28 + size :]

    def array(self, index: int) -> AnyArray:
        """An accessor as (count,) or (count, k); normalised integers as float32 in 0 … 1 or −1 … 1."""
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        dtype, width = np.dtype(_COMPONENTS[accessor["componentType"]]), _NUMBERS[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride, count = view.get("byteStride", dtype.itemsize * width), accessor["count"]
        values = np.ndarray((count, width), dtype, self._binary, start, (stride, dtype.itemsize)).copy()
        if accessor.get("normalized"):
            values = (values / np.iinfo(dtype).max).astype(np.float32)
        return values[:, 0] if width == 1 else values


class GlbWriter:
    """Writes a file part by part: binary data goes to `spool` at once, the document is kept in memory.

    References are indices into the document's lists. The same bytes are written once. Call `finish` after the last
    part.
    """

    def __init__(self, spool: BinaryIO) -> None:
        self._spool = spool
        self._size = 0
        self._known: dict[bytes, int] = {}
        self.nodes: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self._lists: dict[str, list[dict[str, Any]]] = {
            name: [] for name in ("accessors", "bufferViews", "images", "textures")
        }

    def array(self, values: AnyArray, *, target: int = VERTICES, normalized: bool = False) -> int:
        """A new accessor over (n,) or (n, k) numbers; positions and normals are given in the file's axes."""
        width = 1 if values.ndim == 1 else values.shape[1]
        component = next(code for code, name in _COMPONENTS.items() if np.dtype(name) == values.dtype)
        accessor: dict[str, Any] = {
            "bufferView": self._view(np.ascontiguousarray(values).tobytes(), target),
            "componentType": component,
            "count": len(values),
            "type": _SHAPE_OF[width],
        }
        if normalized:
            accessor["normalized"] = True
        if values.dtype == np.float32 and width == 3:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return _appended(self._lists["accessors"], accessor)

    def packed(self, values: AnyArray, *, normalized: bool = False) -> int:
        """A new accessor over (n, k) integers of 8 or 16 bits (KHR_mesh_quantization), each row filled up to a multiple
        of four bytes; it states their least and greatest, as positions must."""
        size = values.dtype.itemsize
        filled = np.zeros((len(values), -(-values.shape[1] * size // 4) * 4 // size), dtype=values.dtype)
        filled[:, : values.shape[1]] = values
        accessor: dict[str, Any] = {
            "bufferView": self._view(filled.tobytes(), VERTICES, filled.shape[1] * size),
            "componentType": next(code for code, name in _COMPONENTS.items() if np.dtype(name) == values.dtype),
            "count": len(values),
            "type": _SHAPE_OF[values.shape[1]],
            "min": values.min(axis=0).tolist(),
            "max": values.max(axis=0).tolist(),
        }
        return _appended(self._lists["accessors"], accessor | ({"normalized": True} if normalized else {}))

    def texture(self, content: bytes, mime: str, *, clamped: bool = False) -> int:
        """A new texture from an image file; it repeats unless it is clamped at its edges."""
        image = _appended(self._lists["images"], {"bufferView": self._view(content, None), "mimeType": mime})
        return _appended(self._lists["textures"], {"source": image, "sampler": int(clamped)})

    def mesh(self, name: str, primitives: Sequence[Mapping[str, Any]]) -> int:
        return _appended(self.meshes, {"name": name, "primitives": list(primitives)})

    def material(self, **values: Any) -> int:
        return _appended(self.materials, values)

    def node(self, **values: Any) -> int:
        return _appended(self.nodes, values)

    def finish(
        self,
        target: BinaryIO,
        spool: BinaryIO,
        roots: Sequence[int],
        asset: Mapping[str, Any],
        extensions: Sequence[str] = (),
    ) -> None:
        """Write the file: the document, then what `spool` holds from its beginning.

        `extensions`: of glTF, that a reader must know.

        Raises:
            ValueError: it would be larger than a glb may be.
        """
        document = {
            "asset": {"version": "2.0", **asset},
            "scene": 0,
            "scenes": [{"nodes": list(roots)}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "samplers": [_sampler(REPEAT), _sampler(CLAMP_TO_EDGE)],
            **{name: values for name, values in self._lists.items() if values},
            "buffers": [{"byteLength": self._size}],
        }
        if extensions:
            document |= {"extensionsUsed": list(extensions), "extensionsRequired": list(extensions)}
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self._size
        if total > LARGEST:
            raise ValueError(f"{total} bytes do not fit into one binary glTF file")
        target.write(MAGIC + _word(2) + _word(total) + _word(len(text)) + _JSON + text + _word(self._size) + _BIN)
        spool.seek(0)
        while chunk := spool.read(1 << 20):
            target.write(chunk)

    def _view(self, raw: bytes, target: int | None, stride: int | None = None) -> int:
        digest = sha256(raw + f"{target} {stride}".encode()).digest()
        if digest in self._known:
            return self._known[digest]
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(raw)}
        if stride is not None:
            view["byteStride"] = stride
        padded = raw + b"\0" * (-len(raw) % 4)
        self._spool.write(padded)
        self._size += len(padded)
        self._known[digest] = _appended(
            self._lists["bufferViews"], view if target is None else {**view, "target": target}
        )
        return self._known[digest]


def read_glb(path: Path) -> Glb:
    """Read a file whole.

    Raises:
        ValueError: it is not a binary glTF 2.0 file.
    """
    return Glb(path.read_bytes())


def _sampler(wrap: int) -> dict[str, int]:
    return {"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap}


def _appended(values: list[dict[str, Any]], value: dict[str, Any]) -> int:
    values.append(value)
    return len(values) - 1


def _word(number: int) -> bytes:
    return number.to_bytes(4, "little")
