"""A tile with a strip of every kind of ground, with the full range of wear and paint of maps, and a pothole."""

from collections.abc import Mapping
from functools import cache
from math import cos, sin

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter

from pavetwin.defects import DefectOptions, place
from pavetwin.scene.ground import details
from pavetwin.scene.ground.materials.compose import MapPyramids
from pavetwin.scene.patches import patch_of
from pavetwin.scene.values import (
    MAP_PX,
    TILE_M,
    DefectPatch,
    Detail,
    Finish,
    GroundKind,
    GroundMaps,
    GroundPiece,
    Mesh,
    Model,
    Tile,
)
from pavetwin.world.model import Defect
from scenes import tiny

KEY = (2, -1)
ORIGIN = (KEY[0] * TILE_M, KEY[1] * TILE_M)
STRIP_M = TILE_M / len(GroundKind)
STREET_M = TILE_M / 8
TURNED_RAD: Mapping[GroundKind, float] = {
    GroundKind.CONCRETE: 0.5,
    GroundKind.PAVING: 2.1,
    GroundKind.KERB: -1.2,
}
"""Stones and slabs lie along their streets; the grain of other kinds along the world's axes."""


def rotation(angle_rad: float) -> np.ndarray:
    """(2, 2): its rows are axes turned by an angle; `xy @ rotation.T` are coordinates along them."""
    return np.array([[cos(angle_rad), sin(angle_rad)], [-sin(angle_rad), cos(angle_rad)]])


def axes(kind: GroundKind) -> np.ndarray:
    """(2, 2): its rows are the directions of a kind's u and v."""
    return rotation(TURNED_RAD.get(kind, 0.0))


def grain_xy(kind: GroundKind, local: np.ndarray) -> np.ndarray:
    """(..., 2) coordinates of a kind's grain at positions in the tile, metres."""
    return np.asarray((local + ORIGIN) @ axes(kind).T)


@cache
def weathered() -> GroundMaps:
    """Smooth fields over the whole range of every channel, edges of paint and bitumen every metre or two."""
    rng = np.random.default_rng(5)

    def field(low: float, high: float, wave_m: float) -> np.ndarray:
        waves = gaussian_filter(rng.standard_normal((MAP_PX, MAP_PX)), wave_m * 31, mode="wrap")
        return np.clip(0.5 * (low + high) + (high - low) * 0.3 * waves / waves.std(), low, high)

    weathering = [field(90, 165, 0.5), field(0, 160, 0.4), field(0, 220, 0.4), field(0, 255, 0.3)]
    drawn = [field(-250, 500, 0.3), field(0, 255, 0.6), field(0, 255, 0.5), field(-350, 400, 0.3)]
    return GroundMaps(
        *(np.clip(np.rint(np.stack(layer, axis=-1)), 0, 255).astype(np.uint8) for layer in (weathering, drawn))
    )


@cache
def pyramids() -> MapPyramids:
    return MapPyramids.of(weathered())


@cache
def pothole() -> Defect:
    """One on a street of 4 m along the tile's south side."""
    south, middle = ORIGIN[1], ORIGIN[1] + STREET_M / 2
    street = tiny.street("street", (ORIGIN[0], middle), (ORIGIN[0] + TILE_M, middle), width_m=STREET_M)
    found = place([street], 4, DefectOptions(population="paper", per_segment=20))
    inside = shapely.box(ORIGIN[0] + 1, south + 0.5, ORIGIN[0] + TILE_M - 1, south + STREET_M - 0.5)
    return next(each for each in found if each.kind == "pothole" and inside.contains(each.polygon))


class Strips:
    """One tile, a strip of each kind of ground. With a pothole there is nothing else."""

    models: Mapping[str, Model] = {}
    facade_textures = np.full((1, 8, 8, 4), 128, dtype=np.uint8)

    def __init__(self, *defects: Defect) -> None:
        self._patches = tuple(patch_of(each, GroundKind.SLABS, finish(GroundKind.SLABS)) for each in defects)
        self._holes = {number: each.polygon.buffer(0.1).bounds for number, each in enumerate(defects)}

    @property
    def details(self) -> Mapping[GroundKind, Detail]:
        return details()

    def keys_near(self, *_: float) -> tuple[tuple[int, int], ...]:
        return (KEY,)

    def tile(self, key: tuple[int, int]) -> Tile:
        assert key == KEY
        strips = () if self._patches else tuple(strip(kind) for kind in GroundKind)
        return Tile(key, strips, (), ())

    def strips_on(self, *_: object) -> np.ndarray:
        return np.zeros((0, 8))

    def maps(self, _: tuple[int, int]) -> GroundMaps:
        return weathered()

    def holes_on(self, _: tuple[int, int]) -> Mapping[int, tuple[float, float, float, float]]:
        return self._holes

    def patch_on(self, _: tuple[int, int], number: int) -> DefectPatch:
        return self._patches[number]


def finish(kind: GroundKind) -> Finish:
    """One of eight."""
    number = kind % 8
    return Finish(1 + number / 64, 1 - number / 32, 0.5 + number / 8, 0.75 + number / 16)


def strip(kind: GroundKind) -> GroundPiece:
    south, north = kind * STRIP_M, (kind + 1) * STRIP_M
    ring = np.array([[0, south], [TILE_M, south], [TILE_M, north], [0, north]])
    corners = np.column_stack([ring, np.zeros(4)]).astype(np.float32)
    up = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
    uv = grain_xy(kind, ring).astype(np.float32)
    return GroundPiece(kind, Mesh(corners, up, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32), uv=uv), finish(kind))
