"""The values a scene is made of, independent of renderers and file formats.

The world is divided into square tiles. A tile holds its ground (meshes by kind of ground, and maps of weathering and
markings), its buildings, its furniture and the patches of its defects; agents are instances of models at one time.
Renderers, the glTF export and the labels all read these values, so that they agree.

Frames: world is east-north-up in metres with the road surface at z = 0; a tile's own frame is the world's, moved to the
tile's south-west corner, which keeps 32-bit coordinates exact; a model's frame is x forward, y left, z up, its origin
on the ground below the middle of its footprint.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from pavetwin.arrays import Float32Array, Float64Array, UInt8Array, UInt32Array

TileKey = tuple[int, int]
"""Column and row of a tile, counted from the origin of the world frame."""

TILE_M: Final = 32.0
"""Side of a tile [m]."""

MAP_PX: Final = 1024
"""Side of a tile's maps [texels]."""

MAP_MARGIN_M: Final = 0.5
"""The maps reach this far beyond their tile on every side, so that filtering across its edge shows no seam [m]."""

SIGNED_DISTANCE_M: Final = 0.25
"""Signed distances in maps are (value − 128) / 127 of this, positive inside [m]."""

TINTS: Final = 4
"""Number of colour slots of a model that an instance can set."""

_FIRST_PARKED: Final = 1 << 22
_FIRST_DEFECT: Final = 1 << 23
"""Labels fit 24 bits: agents of a recording from 1, parked vehicles and defects from these."""


class Finish(NamedTuple):
    """How a piece of ground differs from its kind's detail; factors 0 … 2 in steps of 1/128."""

    red: float = 1.0
    blue: float = 1.0
    """On the reflectance; green stays."""
    grain: float = 1.0
    """On the contrast and relief of the detail."""
    tone: float = 1.0
    """On the reflectance of all colours: of its pavement and its age."""

    @classmethod
    def rounded(cls, red: float, blue: float, grain: float, tone: float) -> "Finish":
        """Factors rounded to steps, the largest below 2."""
        return cls(*(min(255, round(128 * factor)) / 128 for factor in (red, blue, grain, tone)))


PLAIN_FINISH: Final = Finish()


class GroundKind(IntEnum):
    """Material of a piece of ground; the index of its detail textures."""

    ASPHALT = 0
    CONCRETE = 1
    PAVING = 2
    KERB = 3
    GRASS = 4
    EARTH = 5
    CHIP_SEAL = 6
    SLABS = 7
    """Cement concrete of carriageways; its joints are drawn."""
    BLOCKS = 8
    TILES = 9
    SETTS = 10


@dataclass(frozen=True)
class Mesh:
    """Triangles, anticlockwise seen from outside, with what shading needs at each of the n vertices."""

    positions: Float32Array
    """(n, 3) metres."""
    normals: Float32Array
    """(n, 3) unit."""
    indices: UInt32Array
    """(m, 3)"""
    colours: Float32Array | None = None
    """(n, 3) linear RGB reflectance with ambient occlusion multiplied in; None on ground."""
    surface: UInt8Array | None = None
    """(n, 3): roughness and metallic, 255 for 1, and the slot, 0 for its own colour or 1 … TINTS for the instance's."""
    uv: Float32Array | None = None
    """(n, 2): of ground in metres over its detail; of a façade in metres along and up its wall; of a defect's patch
    0 … 1 over its maps, row 0 at v = 0. A part of a model that has it is foliage, uv 0 … 1 over `foliage.leaf_atlas`,
    whose gaps are cut out of it; its triangles come in pairs, a card each."""

    def __post_init__(self) -> None:
        count = len(self.positions)
        expected: tuple[tuple[str, Any, tuple[int, ...], type], ...] = (
            ("positions", self.positions, (count, 3), np.float32),
            ("normals", self.normals, (count, 3), np.float32),
            ("colours", self.colours, (count, 3), np.float32),
            ("surface", self.surface, (count, 3), np.uint8),
            ("uv", self.uv, (count, 2), np.float32),
            ("indices", self.indices, (len(self.indices), 3), np.uint32),
        )
        for name, array, shape, dtype in expected:
            if array is not None and (array.shape != shape or array.dtype != dtype):
                raise ValueError(f"{name} of a mesh: {array.dtype} {array.shape}, expected {dtype.__name__} {shape}")
        if len(self.indices) and int(self.indices.max()) >= count:
            raise ValueError("a triangle of a mesh names a vertex that is not there")


@dataclass(frozen=True)
class Model:
    """A mesh that is instanced many times, in named parts. Most models have the single part 'body'."""

    name: str
    parts: Mapping[str, Mesh]
    extras: Mapping[str, float] = field(default_factory=dict)
    """Metadata of the model: stride_m, crown_radius_m …"""
    person: str = ""
    """Which kind of person it shows, by the names of `traffic.kinds`; empty where it shows none."""


@dataclass(frozen=True)
class Instance:
    """One instance of a model's part."""

    model: str
    part: str
    transform: Float64Array
    """(4, 4) from the model's frame to the world's; column vectors."""
    tints: Float32Array
    """(TINTS, 4): linear RGB of each slot and its emission (0 for a surface that only reflects)."""
    label: int = 0
    """Its label in the instance image; 0 if it has none."""


@dataclass(frozen=True)
class GroundPiece:
    """All ground of one kind and finish in one tile."""

    kind: GroundKind
    mesh: Mesh
    """In the tile's frame, with `uv` in metres: where its detail is sampled (× 1 / size_m). On asphalt, grass and earth
    that is world x and y; paving lies along its street, kerb stones along their kerb. Holes are cut where the patches
    of defects lie."""
    finish: Finish = PLAIN_FINISH


@dataclass(frozen=True)
class GroundMaps:
    """Weathering and marking maps of a tile's ground. Row 0 is south; a texel is (TILE_M + 2·MARGIN) / MAP_PX."""

    weathering: UInt8Array
    """(MAP_PX, MAP_PX, 4): tone (factor on that of the ground's finish, × 128), stain (oil, rubber, damp), dust, polish
    (wheel paths)."""
    drawn: UInt8Array
    """(MAP_PX, MAP_PX, 4): signed distance to paint, which paint of `compose.PAINTS` (0 … 255), its wear, signed
    distance to bitumen (sealed cracks and seams)."""


@dataclass(frozen=True)
class Detail:
    """The detail textures of one kind of ground: square, repeated every `size_m`."""

    size_m: float
    reflectance: UInt8Array
    """(k, k, 4): sRGB-coded reflectance, and the hold of paint: its share of even spread is the wear at which paint has
    gone from here (0 first, 255 last). Row 0 is v = 0."""
    relief: UInt8Array
    """(k, k, 4): normal x and y (128 for 0, 255 for 1), height (0 … 255 of its range), roughness."""


@dataclass(frozen=True)
class FacadePiece:
    """Walls and roof of one building."""

    building: str
    mesh: Mesh
    """In the tile's frame; `colours` and `surface` without slots; `uv` in metres."""
    layer: int
    """Layer of the façade textures; −1 for plain vertex colours."""


@dataclass(frozen=True)
class DefectPatch:
    """The pavement around one defect, drawn from its heightfield in place of the road that was cut away."""

    label: int
    mesh: Mesh
    """In the defect's frame, with `uv` over the maps."""
    coarse: Mesh
    """Likewise, for pixels of `patches.COARSE_PIXEL_M` and more."""
    transform: Float64Array
    """(4, 4) from the defect's frame to the world's."""
    relief: UInt8Array
    """(rows, columns, 4): normal x and y (128 for 0), reflectance × value / 128, ambient occlusion (255 open)."""
    mask: UInt8Array
    """(rows, columns): 255 where the label is, else 0."""
    lost: UInt8Array
    """(rows, columns): share of the road's surface that is gone, with the paint and sealant on it, 0 … 255."""
    kind: GroundKind = GroundKind.ASPHALT
    """Kind and finish of the pavement that it lies in."""
    finish: Finish = PLAIN_FINISH


@dataclass(frozen=True)
class Tile:
    """The static objects of one square of the world. Its ground's maps and defects are made separately: they take most
    of the time, and are needed only when the ground is in view."""

    key: TileKey
    """Column and row: its south-west corner is key × TILE_M in the world frame."""
    ground: tuple[GroundPiece, ...]
    facades: tuple[FacadePiece, ...]
    instances: tuple[Instance, ...]
    """Trees, lights, signs, manholes …"""
    thin: Float64Array = field(default_factory=lambda: np.zeros((0, 7)))
    """(n, 7): wires and twigs as of `scene.thin`; they are drawn as instances, and shade the ground by strips."""

    @property
    def origin(self) -> tuple[float, float]:
        """The south-west corner in the world frame, in metres."""
        return tile_origin(self.key)


def tile_origin(key: TileKey) -> tuple[float, float]:
    """The south-west corner of a tile in the world frame, in metres."""
    return key[0] * TILE_M, key[1] * TILE_M


def tile_bounds(key: TileKey) -> tuple[float, float, float, float]:
    """A tile's square: west, south, east, north in metres of the world frame."""
    return key[0] * TILE_M, key[1] * TILE_M, (key[0] + 1) * TILE_M, (key[1] + 1) * TILE_M


def tile_at(x_m: float, y_m: float) -> TileKey:
    """The tile that a place of the world frame lies in."""
    return math.floor(x_m / TILE_M), math.floor(y_m / TILE_M)


def agent_label(agent: int) -> int:
    """The label of an agent of a recording in instance images."""
    if not 0 <= agent < _FIRST_PARKED - 1:
        raise ValueError(f"agent {agent} has no label: there are {_FIRST_PARKED - 1}")
    return 1 + agent


def parked_label(place: int) -> int:
    """The label of the vehicle in a parking place of a world in instance images."""
    if not 0 <= place < _FIRST_DEFECT - _FIRST_PARKED:
        raise ValueError(f"parking place {place} has no label: there are {_FIRST_DEFECT - _FIRST_PARKED}")
    return _FIRST_PARKED + place


def defect_label(defect: int) -> int:
    """The label of a defect of a world in instance images."""
    if not 0 <= defect < _FIRST_DEFECT:
        raise ValueError(f"defect {defect} has no label: there are {_FIRST_DEFECT}")
    return _FIRST_DEFECT + defect


def labelled_agent(label: int) -> int | None:
    """The agent that a label stands for, or None."""
    return label - 1 if 0 < label < _FIRST_PARKED else None


def labelled_place(label: int) -> int | None:
    """The parking place whose vehicle a label stands for, or None."""
    return label - _FIRST_PARKED if _FIRST_PARKED <= label < _FIRST_DEFECT else None


def labelled_defect(label: int) -> int | None:
    """The defect that a label stands for, or None."""
    return label - _FIRST_DEFECT if label >= _FIRST_DEFECT else None
