"""Polygons collected by texture layer, then merged into one mesh per layer."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.scene.buildings.layers import FacadeTexture
from pavetwin.scene.meshes import corners_of, merged
from pavetwin.scene.palettes import Colour
from pavetwin.scene.values import Mesh
from pavetwin.world.model import Surface

ROUGH = 0.85


@dataclass
class _PolygonBatch:
    """Polygons of one layer with k corners each."""

    positions: list[Float64Array] = field(default_factory=list)
    colours: list[Float64Array] = field(default_factory=list)
    uv: list[Float64Array] = field(default_factory=list)
    rough: list[Float64Array] = field(default_factory=list)

    def add(self, positions: Float64Array, colour: npt.ArrayLike, uv: Float64Array, roughness: float) -> None:
        self.positions.append(positions)
        self.colours.append(np.broadcast_to(np.asarray(colour, dtype=np.float64), positions.shape))
        self.uv.append(uv)
        self.rough.append(np.full(len(positions), roughness))


@dataclass
class Faces:
    """Flat faces of one building. Points are metres in one frame; colours linear reflectances."""

    _quads: defaultdict[FacadeTexture, _PolygonBatch] = field(default_factory=lambda: defaultdict(_PolygonBatch))
    _triangles: defaultdict[FacadeTexture, _PolygonBatch] = field(default_factory=lambda: defaultdict(_PolygonBatch))

    def quads(
        self,
        layer: FacadeTexture,
        corners: npt.ArrayLike,
        colour: npt.ArrayLike,
        *,
        uv: npt.ArrayLike | None = None,
        roughness: float = ROUGH,
    ) -> None:
        """Add (n, 4, 3) corners, anticlockwise from outside.

        Args:
            corners: (n, 4, 3) or (4, 3); a quad may have two corners in one place.
            colour: (3,), (n, 1, 3) or (n, 4, 3).
            uv: (n, 4, 2) metres; zeros when not given.
            roughness: 0 … 1, for faces without texture.
        """
        points = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 3)
        if len(points):
            coordinates = np.zeros((len(points), 4, 2)) if uv is None else np.asarray(uv, dtype=np.float64)
            self._quads[layer].add(points, colour, coordinates.reshape(-1, 4, 2), roughness)

    def level(
        self, layer: FacadeTexture, area: Surface, height_m: float, colour: Colour, roughness: float = ROUGH
    ) -> None:
        """Add a level area seen from above; its texture lies along x and y."""
        corners = corners_of(shapely.constrained_delaunay_triangles(area))
        self.slopes(layer, corners, np.full(corners.shape[:2], height_m), colour, roughness)

    def slopes(
        self,
        layer: FacadeTexture,
        corners: Float64Array,
        heights: Float64Array,
        colour: Colour,
        roughness: float = ROUGH,
        uv: Float64Array | None = None,
    ) -> None:
        """Add triangles (n, 3, 2) with heights (n, 3), turned to be seen from above."""
        points = np.concatenate([corners, heights[..., None]], axis=2)
        if uv is None:
            uv = corners.copy()
        normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        over = normal[:, 2] < 0
        points[over] = points[over][:, ::-1]
        uv[over] = uv[over][:, ::-1]
        solid = np.einsum("nk,nk->n", normal, normal) > 1e-18
        if solid.any():
            self._triangles[layer].add(points[solid], colour, uv[solid], roughness)

    def box(
        self,
        layer: FacadeTexture,
        base: Float64Array,
        low_m: float,
        high_m: float,
        colour: Colour,
        roughness: float = ROUGH,
    ) -> None:
        """Add the sides and the top of an upright prism over a ring (n, 2), anticlockwise, not closed."""
        self.walls(layer, base, low_m, high_m, colour, roughness)
        self.level(FacadeTexture.PLAIN, shapely.Polygon(base), high_m, colour, roughness)

    def walls(
        self,
        layer: FacadeTexture,
        ring: Float64Array,
        low_m: float,
        high_m: float,
        colour: npt.ArrayLike,
        roughness: float = ROUGH,
    ) -> None:
        """Add upright walls over a closed ring (n, 2), seen from its right side when walked along."""
        start, end = ring, np.roll(ring, -1, axis=0)
        length = np.hypot(*(end - start).T)
        along = np.cumsum(length) - length
        beyond = along + length
        ends = ((start, along, low_m), (end, beyond, low_m), (end, beyond, high_m), (start, along, high_m))
        corners = np.stack([_at(points, height_m) for points, _, height_m in ends], axis=1)
        uv = np.stack([_at(way, height_m) for _, way, height_m in ends], axis=1)
        self.quads(layer, corners, colour, uv=uv, roughness=roughness)

    def meshes(self) -> dict[FacadeTexture, Mesh]:
        """The added faces, one mesh per layer, in the layers' order."""
        layers = sorted({*self._quads, *self._triangles})
        batches = ((self._quads, 4), (self._triangles, 3))
        return {
            layer: merged([_flattened(of[layer], corners) for of, corners in batches if layer in of])
            for layer in layers
        }


def _at(points: Float64Array, height_m: float) -> Float64Array:
    return np.column_stack([points, np.full(len(points), height_m)])


def _flattened(batch: _PolygonBatch, corners: int) -> Mesh:
    points = np.concatenate(batch.positions)
    diagonals = (points[:, 2] - points[:, 0], points[:, 3 if corners == 4 else 2] - points[:, 1])
    normal = np.cross(*diagonals)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    fan = np.array([[0, 1, 2], [0, 2, 3]] if corners == 4 else [[0, 1, 2]])
    surface = np.zeros((len(points) * corners, 3), dtype=np.uint8)
    surface[:, 0] = np.repeat(np.round(255 * np.concatenate(batch.rough)), corners)
    return Mesh(
        positions=points.reshape(-1, 3).astype(np.float32),
        normals=np.repeat(normal, corners, axis=0).astype(np.float32),
        indices=(corners * np.arange(len(points))[:, None, None] + fan).reshape(-1, 3).astype(np.uint32),
        colours=np.concatenate(batch.colours).reshape(-1, 3).astype(np.float32),
        surface=surface,
        uv=np.concatenate(batch.uv).reshape(-1, 2).astype(np.float32),
    )
