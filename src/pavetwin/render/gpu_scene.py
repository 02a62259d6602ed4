"""The draw list of one frame: what is near and in view, at the level of detail of its size in pixels."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, Int64Array
from pavetwin.render.gpu import Gpu
from pavetwin.render.instances import InstanceBatch, InstanceBuffer, PartTable
from pavetwin.render.meshes import FaceCulling, GpuMesh, split_by_area, upload_model
from pavetwin.render.nearby import FAR_M, ground_seen, looks_beyond, looks_down, pavement_seen, tile_seen, wanted_keys
from pavetwin.render.passes import DrawList, MeshDraw, PatchDraw
from pavetwin.render.projection import ShadowFit, planes
from pavetwin.render.tile_cache import Drawable, GpuPavement, GpuTile, TileCache, TileLayouts
from pavetwin.scene.coarser import FINEST_M, coarser, thinned
from pavetwin.scene.light import Light
from pavetwin.scene.patches import COARSE_PIXEL_M
from pavetwin.scene.values import Mesh, TileKey
from pavetwin.scene.view import View

LEVELS: Final = 5  # Number of coarser levels
_CLOSED_SHARE: Final = 0.98
_CELL_PX: Final = 0.75


def culling_of(mesh: Mesh) -> FaceCulling:
    """Which faces of a model's triangles are drawn."""
    if mesh.uv is not None:
        return FaceCulling.ALPHA_CUTOUT
    return FaceCulling.BACK_CULLED if is_closed(mesh) else FaceCulling.DOUBLE_SIDED


def is_closed(mesh: Mesh) -> bool:
    """Whether a mesh is closed: nearly every edge is shared by a second triangle of opposite direction."""
    _, place = np.unique(np.round(mesh.positions / 1e-4).astype(np.int64), axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.indices]
    starts, ends = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    size = int(place.max(initial=0)) + 1
    ways, there = starts.astype(np.int64) * size + ends, ends.astype(np.int64) * size + starts
    return bool(np.isin(ways, there).mean() > _CLOSED_SHARE) if len(ways) else False


def level_of(least_px2: Float64Array, area_m2: Float64Array, pixel_m: Float64Array) -> Int64Array:
    """The coarsest level without a visible difference, 0 … LEVELS.

    Args:
        least_px2: (n,) `foliage_px2` of each mesh.
        area_m2: (n,) of its mean triangle.
        pixel_m: (n,) side of a pixel where it stands.
    """
    solid = np.floor(np.log2(np.maximum(_CELL_PX * pixel_m / FINEST_M, 0.5))) + 1
    thin = np.floor(np.log2(np.maximum(least_px2 * pixel_m**2 / np.maximum(area_m2, 1e-9), 1.0)))
    return np.clip(np.where(least_px2 > 0, thin, solid), 0, LEVELS).astype(np.int64)


def casting(mesh: Mesh, level: int) -> Mesh:
    """The shadow caster of a mesh at a level: for leaf cards, every other card.

    All of them let half a percent of the sun through a crown's middle; measured crowns in leaf let 1.3 to 5.3 % through
    (Konarska et al. 2014, Theoretical and Applied Climatology 117). The cost of a shadow map is the area of its cards.
    """
    return thinned(mesh, level, sparser=2) if mesh.uv is not None else coarser(mesh, level)


SHADE_FAR_M: Final = 60.0  # Objects beyond this distance have no contact shadow
SHADOW_TEXELS: Final = 4.0  # Details of shadows smaller than this are left out
NEAR_PX2: Final = 12.0
"""Models whose mean triangle covers more than this are lit at every pixel, except for their small triangles; others are
lit at their vertices."""

SMALL_PX2: Final = 24.0  # Triangles that cover less than about this are lit at their vertices
FAR_LEVEL: Final = 2
"""From this level on, with pixels of 4 cm, models that have a part for it are drawn by their part `far`."""


class GpuScene:
    """The models and tiles of one scene on the device, and the draw list of each frame."""

    def __init__(self, gpu: Gpu, scene: Drawable, layouts: TileLayouts) -> None:
        self._gpu, self._scene = gpu, scene
        self.parts = PartTable(scene.models)
        self.tiles = TileCache(gpu, scene, self.parts, layouts)
        self._meshes: dict[tuple[int, int, bool], GpuMesh] = {}
        """Keyed by part, level, and whether it is a shadow caster."""
        self._strips_of: tuple[Light | None, dict[TileKey, Float64Array]] = None, {}
        """Under the latest light, by tile."""
        self._split: dict[tuple[int, int, int], tuple[GpuMesh, GpuMesh]] = {}
        """The large triangles and the small ones, by part, level, and binary logarithm of the area between them."""

    def mesh(self, part: int, level: int = 0, *, casts: bool = False) -> GpuMesh:
        """The mesh of a part at a level of detail; `casts`: as a shadow caster."""
        mesh, shadow = self.parts.meshes[part], self.parts.shadow.get(part)
        key = part, level, casts and (mesh.uv is not None or shadow is not None)
        if key not in self._meshes:
            made = (shadow or casting(mesh, level)) if casts else self._made(part, level)
            culling = FaceCulling.BACK_CULLED if part in self.parts.single_sided else culling_of(mesh)
            self._meshes[key] = upload_model(self._gpu, made, culling)
        return self._meshes[key]

    def _made(self, part: int, level: int) -> Mesh:
        mesh = self.parts.meshes[part]
        return coarser(self.parts.far.get(part, mesh) if level >= FAR_LEVEL else mesh, level)

    def draws(
        self,
        view: View,
        light: Light,
        shadow: ShadowFit,
        agents: tuple[InstanceBatch, InstanceBatch],
        records: InstanceBuffer,
    ) -> DrawList:
        """Objects in view, and those that cast shadows into it. `agents`: those drawn, and those with shadows alone."""
        bounds = planes(view)
        tiles = [self.tiles.tile(key) for key in wanted_keys(self._scene, view, light)]
        batch = InstanceBatch.joined([*agents, *(tile.batch for tile in tiles)])
        shown, moving = len(agents[0]), len(agents[0]) + len(agents[1])
        placed = [(tile, records.add_place(tile.origin)) for tile in tiles]
        seen = [(tile, record) for tile, record in placed if tile_seen(tile.origin, view, bounds)]
        grounds = [
            (tile, self.tiles.pavement(tile.key), record)
            for tile, record in seen
            if pavement_seen(tile.origin, view, bounds)
        ]
        patches = self._patches(grounds, view, bounds, records)
        relative = batch.centre - view.position
        ahead = relative @ view.rotation[:, 2]
        inside = (relative @ bounds.T > -batch.radius[:, None]).all(axis=1) & (ahead - batch.radius < FAR_M)
        inside = np.asarray(inside & (batch.radius * view.focal_px > np.maximum(ahead, 0.1)))
        inside[shown:moving] = False
        across = np.abs(relative @ shadow.across.T - shadow.middle)
        casts = self.parts.casts[batch.part]
        throwing = np.flatnonzero((across < shadow.half_m + batch.radius[:, None]).all(axis=1) & casts)
        pixel = np.maximum(np.linalg.norm(relative, axis=1) - batch.radius, 0.5) / view.focal_px
        stretch = np.linalg.norm(batch.transform[:, :, :3], axis=1).mean(axis=1)
        area = self.parts.area_m2[batch.part] * stretch**2
        level = level_of(self.parts.least_px2[batch.part], area, pixel)
        # On average half of a triangle's area is visible.
        close = area / pixel**2 / 2 > NEAR_PX2
        small = 2 * SMALL_PX2 * (pixel / stretch) ** 2
        near, far = self._close(batch, np.flatnonzero(inside & close), level, small, records)
        distant = np.flatnonzero(inside & ~close)
        for kind, count, first in records.add_batch(batch.only(distant), level[distant]):
            far.append((self.mesh(*kind), count, first))
        # A few texels of the filtered shadow map correspond to one pixel of the image.
        coarse = np.maximum(pixel, SHADOW_TEXELS * shadow.texel_m)
        # The shadow of the camera's own vehicle is right before the lens, where four texels would show as a step.
        coarse[shown:moving] = pixel[shown:moving]
        shade_level = level_of(self.parts.least_px2[batch.part], area, coarse)
        casters = [
            (self.mesh(*kind, casts=True), count, first)
            for kind, count, first in records.add_batch(batch.only(throwing), shade_level[throwing])
        ]
        for tile, record in placed:
            casters += [(mesh, 1, record) for mesh in (tile.facades, tile.kerbs) if mesh is not None]
        # Contact shadows reach into the image from outside it.
        rimmed = (relative @ bounds.T > -2 * batch.radius[:, None] - 1).all(axis=1) & (ahead < SHADE_FAR_M) & casts
        shades = records.add_shades(batch.only(np.flatnonzero(rimmed)), self.parts)
        strips = records.add_strips(self._strips(tiles, view, light, bounds))
        levels = np.where(inside, level, -1)[:shown]
        down = looks_down(view, light)
        sky = looks_beyond(view)
        return DrawList(seen, grounds, patches, near, far, casters, shades, strips, levels, sky, down)

    def _strips(self, tiles: Sequence[GpuTile], view: View, light: Light, bounds: Float64Array) -> Float64Array:
        """The strips of ground (n, 8) in view that wires and twigs shade."""
        if not light.sun_klux.any():
            return np.zeros((0, 8))
        known = self._strips_of[1] if self._strips_of[0] == light else {}
        found = {
            tile.key: known[tile.key] if tile.key in known else self._scene.strips_on(tile.key, light.to_sun)
            for tile in tiles
        }
        self._strips_of = light, found
        strips = np.concatenate(list(found.values()))
        middle = (strips[:, :3] + strips[:, 3:6]) / 2
        reach = np.linalg.norm(strips[:, 3:6] - strips[:, :3], axis=1) / 2 / light.to_sun[2] + 0.5
        middle -= light.to_sun * ((middle[:, 2] - strips[:, 7]) / light.to_sun[2])[:, None]
        relative = middle - view.position
        near = (relative @ view.rotation[:, 2]) < SHADE_FAR_M
        seen: Float64Array = strips[(relative @ bounds.T > -reach[:, None]).all(axis=1) & near]
        return seen

    def _close(
        self, batch: InstanceBatch, rows: Int64Array, level: Int64Array, small_m2: Float64Array, records: InstanceBuffer
    ) -> tuple[list[MeshDraw], list[MeshDraw]]:
        """The large triangles of some rows, and their small ones.

        `small_m2`: (n,) area of a triangle of each instance below which it is lit at its vertices.
        """
        near, far = [], []
        for (part, detail), count, first in records.add_batch(batch.only(rows), level[rows]):
            mesh = self.mesh(part, detail)
            if mesh.culling is FaceCulling.ALPHA_CUTOUT:
                near.append((mesh, count, first))
                continue
            alike = rows[(batch.part[rows] == part) & (level[rows] == detail)]
            large, small = self._halves(part, detail, float(small_m2[alike].min()))
            near.append((large, count, first))
            far.append((small, count, first))
        return near, far

    def _halves(self, part: int, level: int, area_m2: float) -> tuple[GpuMesh, GpuMesh]:
        """The triangles of a mesh that are larger than an area, rounded down to a power of two, and the others."""
        octave = math.floor(math.log2(area_m2))
        key = part, level, octave
        if key not in self._split:
            self._split[key] = split_by_area(self._gpu, self.mesh(part, level), self._made(part, level), 2.0**octave)
        return self._split[key]

    def _patches(
        self,
        grounds: Sequence[tuple[GpuTile, GpuPavement, int]],
        view: View,
        bounds: Float64Array,
        records: InstanceBuffer,
    ) -> list[PatchDraw]:
        """The defects of these tiles that are in view."""
        found = []
        for tile, pavement, _ in grounds:
            for number, box in self._scene.holes_on(tile.key).items():
                patch = self.tiles.patch(tile, number) if ground_seen(box, view, bounds) else None
                if patch is not None:
                    mesh = patch.coarse if _pixel_m(box, view) >= COARSE_PIXEL_M else patch.mesh
                    record = records.add_place(tile.origin, label=patch.label)
                    found.append(PatchDraw(patch, mesh, pavement, tile.origin, record))
        return found


def _pixel_m(box: tuple[float, float, float, float], view: View) -> float:
    """Side of a pixel at the nearest point of a box on the ground."""
    west, south, east, north = box
    nearest = np.clip(view.position, (west, south, 0.0), (east, north, 0.0))
    return float(np.linalg.norm(nearest - view.position)) / view.focal_px
