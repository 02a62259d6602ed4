"""Levels of detail of tiles for browsers, and meshes as small quantised files."""

import gzip
import math
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Final

import numpy as np

from pavetwin._core import __version__
from pavetwin.arrays import Float64Array, FloatArray, Int16Array, UInt8Array
from pavetwin.scene.buildings import FACADE_REPEAT_M, HouseDetail
from pavetwin.scene.export.glb_models import indices_of
from pavetwin.scene.glb import GlbWriter
from pavetwin.scene.values import TILE_M, Mesh

FORMAT: Final = 1
"""Version of the manifest and the files; it changes with what a client needs to read them."""


@dataclass(frozen=True)
class WebLevel:
    """How finely the tiles of one level are made."""

    number: int
    """0 is the finest."""
    side: int
    """Side of its squares, in tiles of the scene."""
    texel_m: float | None
    """Pixels of the image of its ground; None for a colour at each vertex."""
    houses: HouseDetail
    error_m: float
    """Greatest distance between the surfaces of its ground and houses and those of the finest level, without defects.
    Reveals and sills reach 0.3 m, equipment on flat roofs 1.4 m, and a hipped roof
    in wide steps loses less."""
    to_m: float
    """Nearer than this a client shows it; the coarsest is shown at any distance."""
    smallest_m: float
    """Objects whose second largest dimension is less are left out."""

    @property
    def side_m(self) -> float:
        return self.side * TILE_M


WEB_LEVELS: Final = (
    WebLevel(0, 1, 0.0625, HouseDetail.FULL, 0.0, 55.0, 0.0),
    WebLevel(1, 1, 0.25, HouseDetail.FLAT, 0.5, 150.0, 0.1),
    WebLevel(2, 2, None, HouseDetail.BLANK, 1.6, float("inf"), 1.5),
)

DEFECTS_A_PART: Final = 3
"""Reliefs of defects in one file: each takes a tenth of a second or more."""

DEFECT_TEXEL_M: Final = 0.012
"""Pixels of the images of defects."""

DEFECTS_TO_M: Final = 40.0
"""Nearer than this a client shows the relief of defects in place of the image of the ground."""

MODEL_TRIANGLES: Final = (2600, 460, 90)
CROWN_TRIANGLES: Final = (1800, 450, 220)
"""Most triangles of a part of a model at each level, and of a crown of leaves."""


FINEST_STEP_M: Final = 2.0**-10
FACADE_STEPS: Final = 512
"""Steps of façade coordinates in one repeat of their texture."""

_MOST: Final = 32_767
_PACK: Final = 6
"""Level of gzip."""


class PackedFile:
    """A file of quantised meshes while it is filled. A reader needs KHR_mesh_quantization."""

    def __init__(self) -> None:
        self._spool = BytesIO()
        self.writer = GlbWriter(self._spool)
        self._roots: list[int] = []
        self._plain: int | None = None

    def add(
        self,
        name: str,
        mesh: Mesh,
        centre_m: tuple[float, float, float],
        place_m: tuple[float, float, float],
        *,
        colours: FloatArray | None = None,
        uv: FloatArray | None = None,
        facade_uv: FloatArray | None = None,
        layers: UInt8Array | None = None,
        image: bytes | None = None,
        extras: Mapping[str, Any] | None = None,
    ) -> None:
        """Add a mesh as a node of its own.

        Args:
            centre_m: in the mesh's frame, from which its steps are counted.
            place_m: of that centre in the world frame.
            colours: (n, 3) linear.
            uv: (n, 2) 0 … 1 over its image, (0, 0) the image's upper left corner.
            facade_uv: (n, 2) metres over the textures of façades.
            layers: (n,) of those textures, 1 for the first, 0 for none; or any other number for each vertex.
            image: a JPEG file.
        """
        if not len(mesh.indices):
            return
        local = mesh.positions.astype(np.float64) - np.array(centre_m)
        step = step_of(float(np.abs(local).max()))
        attributes = {
            "POSITION": self.writer.packed(_in_file_axes(steps_of(local, step))),
            "NORMAL": self.writer.packed(_in_file_axes(np.round(127 * mesh.normals).astype(np.int8)), normalized=True),
        }
        if colours is not None:
            attributes["COLOR_0"] = self.writer.packed(_opaque(colours), normalized=True)
        if uv is not None:
            coded = np.round(65_535 * np.clip(uv, 0, 1)).astype(np.uint16)
            attributes["TEXCOORD_0"] = self.writer.packed(coded, normalized=True)
        if facade_uv is not None:
            turns = np.round(facade_uv * (FACADE_STEPS / FACADE_REPEAT_M))
            attributes["_FACADE"] = self.writer.packed(np.clip(turns, -_MOST, _MOST).astype(np.int16))
        if layers is not None:
            attributes["_LAYER"] = self.writer.packed(layers.reshape(-1, 1).astype(np.uint8))
        primitive = {
            "attributes": attributes,
            "indices": indices_of(self.writer, mesh.indices),
            "material": self._material(name, image),
        }
        x, y, z = place_m
        values: dict[str, Any] = {"extras": dict(extras)} if extras else {}
        index = self.writer.mesh(name, [primitive])
        self._roots.append(
            self.writer.node(name=name, mesh=index, translation=[y, z, x], scale=[step, step, step], **values)
        )

    def packed(self, extras: Mapping[str, Any]) -> bytes:
        """The finished file, gzipped; the same content gives the same bytes."""
        target = BytesIO()
        asset = {"generator": f"PaveTwin {__version__}", "extras": dict(extras)}
        self.writer.finish(target, self._spool, self._roots, asset, ("KHR_mesh_quantization",))
        return gzip.compress(target.getvalue(), _PACK, mtime=0)

    def _material(self, name: str, image: bytes | None) -> int:
        pbr: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
        if image is not None:
            texture = {"index": self.writer.texture(image, "image/jpeg", clamped=True)}
            return self.writer.material(name=name, pbrMetallicRoughness={**pbr, "baseColorTexture": texture})
        if self._plain is None:
            self._plain = self.writer.material(name="plain", pbrMetallicRoughness=pbr)
        return self._plain


def step_of(reach_m: float) -> float:
    """The step with which 16 bits reach so far: `FINEST_STEP_M`, or the next power of two that does."""
    return max(FINEST_STEP_M, 2.0 ** math.ceil(math.log2(max(reach_m, 1e-9) / _MOST)))


def steps_of(positions_m: Float64Array, step_m: float) -> Int16Array:
    """(n, 3) positions as whole steps."""
    return np.round(positions_m / step_m).astype(np.int16)


def _in_file_axes(values: Any) -> Any:
    return np.ascontiguousarray(values[:, [1, 2, 0]])


def _opaque(colours: FloatArray) -> UInt8Array:
    coded = np.full((len(colours), 4), 255, dtype=np.uint8)
    coded[:, :3] = np.round(255 * np.clip(colours, 0, 1))
    return coded
