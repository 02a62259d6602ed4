"""A level plane of one reflectance to draw boxes on, and a ray caster that knows nothing of triangles or devices."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import product
from math import cos, floor, sin
from typing import Any

import numpy as np

from pavetwin.render.renderer import Renderer, SceneRadiance
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.values import (
    TILE_M,
    TINTS,
    Detail,
    GroundKind,
    GroundMaps,
    GroundPiece,
    Instance,
    Mesh,
    Model,
    Tile,
)
from pavetwin.scene.view import View
from pavetwin.scene.wires import shaded_strips
from scenes.solids import BOX, solids

GREY = 0.18
_TEXELS = 8


@dataclass(frozen=True)
class Box:
    """An upright box on the ground, or hovering."""

    x: float
    y: float
    length_m: float
    width_m: float
    height_m: float
    yaw_rad: float = 0.0
    z: float = 0.0
    label: int = 0
    reflectance: float = 0.4
    glow: float = 0.0

    @property
    def instance(self) -> Instance:
        tints = np.zeros((TINTS, 4), dtype=np.float32)
        tints[0] = (self.reflectance,) * 3 + (self.glow,)
        transform = np.eye(4)
        transform[:2, :2] = [[cos(self.yaw_rad), -sin(self.yaw_rad)], [sin(self.yaw_rad), cos(self.yaw_rad)]]
        transform[:3, :3] *= (self.length_m, self.width_m, self.height_m)
        transform[:3, 3] = self.x, self.y, self.z
        return Instance(BOX, "body", transform, tints, self.label)

    @property
    def middle(self) -> np.ndarray:
        return np.array([self.x, self.y, self.z + self.height_m / 2])

    @property
    def corners(self) -> np.ndarray:
        """(8, 3)"""
        local = np.array([(x, y, z, 1.0) for x, y, z in product((-0.5, 0.5), (-0.5, 0.5), (0.0, 1.0))])
        return (local @ self.instance.transform.T)[:, :3]


@dataclass(frozen=True)
class Plane:
    """Tiles of bare asphalt within a reach of the origin; what stands on them may be given by tile."""

    reach_m: float = 400.0
    reflectance: float = GREY
    standing: Sequence[Box] = ()
    thin: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    models: Mapping[str, Model] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "models", {**self.models, **solids()})

    @property
    def details(self) -> Mapping[GroundKind, Detail]:
        return dict.fromkeys(GroundKind, _even(self.reflectance))

    @property
    def facade_textures(self) -> np.ndarray:
        return np.full((1, _TEXELS, _TEXELS, 4), 128, dtype=np.uint8)

    def keys_near(self, x_m: float, y_m: float, radius_m: float, /) -> tuple[tuple[int, int], ...]:
        columns = range(floor((x_m - radius_m) / TILE_M), floor((x_m + radius_m) / TILE_M) + 1)
        rows = range(floor((y_m - radius_m) / TILE_M), floor((y_m + radius_m) / TILE_M) + 1)
        last = floor(self.reach_m / TILE_M)
        return tuple(key for key in product(columns, rows) if max(map(abs, key)) <= last)

    def tile(self, key: tuple[int, int]) -> Tile:
        ring = np.array([[0, 0, 0], [TILE_M, 0, 0], [TILE_M, TILE_M, 0], [0, TILE_M, 0]], dtype=np.float32)
        up = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
        mesh = Mesh(ring, up, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32), uv=ring[:, :2].copy())
        here = [box for box in self.standing if (floor(box.x / TILE_M), floor(box.y / TILE_M)) == key]
        pieces = (GroundPiece(GroundKind.ASPHALT, mesh),)
        return Tile(key, pieces, (), tuple(box.instance for box in here))

    def strips_on(self, key: tuple[int, int], to_sun: np.ndarray) -> np.ndarray:
        here = np.floor((self.thin[:, :2] + self.thin[:, 3:5]) / 2 / TILE_M) == key
        return shaded_strips(self.thin[here.all(axis=1)], to_sun, lambda xy: np.zeros(len(np.asarray(xy))))

    def maps(self, _: tuple[int, int]) -> GroundMaps:
        return _untouched()

    def holes_on(self, _: tuple[int, int]) -> Mapping[int, tuple[float, float, float, float]]:
        return {}

    def patch_on(self, _: tuple[int, int], __: int) -> None:
        raise AssertionError("there are no holes")


@cache
def _even(reflectance: float) -> Detail:
    colour = np.full((_TEXELS, _TEXELS, 4), round(255 * float(srgb_of_linear(reflectance))), dtype=np.uint8)
    relief = np.empty((_TEXELS, _TEXELS, 4), dtype=np.uint8)
    relief[:] = (128, 128, 128, 255)
    return Detail(2.0, colour, relief)


@cache
def _untouched() -> GroundMaps:
    weathering, drawn = (np.zeros((_TEXELS, _TEXELS, 4), dtype=np.uint8) for _ in range(2))
    weathering[..., 0] = 128
    return GroundMaps(weathering, drawn)


@cache
def plane_renderer() -> Renderer:
    """One for all tests of a process."""
    return Renderer(Plane())


def rendered_again(scene: Plane) -> Renderer:
    """A renderer of a plane of its own."""
    return Renderer(replace(scene))


@dataclass(frozen=True)
class Cast:
    """The first hit of the ray through each pixel's middle."""

    labels: np.ndarray
    """(height, width)"""
    depth_m: np.ndarray
    """(height, width) along the axis, inf for nothing."""
    amodal: Mapping[int, int]
    """Label → pixels whose ray meets it, whatever is before it."""


def cast(view: View, boxes: Sequence[Box]) -> Cast:
    """Boxes on the plane z = 0, by the slabs of every box in its own frame."""
    width, height = view.size_px
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    rays = view.rays(pixels)
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = -view.position[2] / rays[..., 2]
    depth = np.where(ground > 0, ground, np.inf)
    labels = np.zeros((height, width), dtype=np.uint32)
    amodal: dict[int, int] = {}
    for box in boxes:
        back = np.linalg.inv(box.instance.transform)
        start, along = back[:3, :3] @ view.position + back[:3, 3], rays @ back[:3, :3].T
        with np.errstate(divide="ignore"):
            first = (np.array([-0.5, -0.5, 0.0]) - start) / along
            second = (np.array([0.5, 0.5, 1.0]) - start) / along
        enters, leaves = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
        met = (enters <= leaves) & (leaves > 0)
        if box.label:
            amodal[box.label] = int(met.sum())
        nearer = met & (enters < depth)
        depth[nearer], labels[nearer] = enters[nearer], box.label
    return Cast(labels, depth, amodal)


@dataclass(frozen=True)
class SeenLight(SceneRadiance):
    """The light behind a lens with the amodal pixels of each label."""

    amodal_px: dict[int, int]


def light_of(renderer: Renderer, view: View, **given: Any) -> SeenLight:
    """The light that a renderer sees from a view."""
    seen, count = renderer.radiance(view, **given)
    return SeenLight(**vars(seen), amodal_px=count.result() if count else {})
