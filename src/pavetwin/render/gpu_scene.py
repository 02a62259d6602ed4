"""The draw list of one frame, from the whole scene: what is near and in view, at the level of detail of its pixels."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.render.gpu import Gpu
from pavetwin.render.instances import InstanceBatch, InstanceBuffer, PartTable
from pavetwin.render.levels import casting, coarser, culling_of, level_of
from pavetwin.render.meshes import FaceCulling, GpuMesh, upload_model
from pavetwin.render.nearby import FAR_M, ground_seen, looks_beyond, looks_down, tile_seen, wanted_keys
from pavetwin.render.passes import DrawList, PatchDraw
from pavetwin.render.projection import ShadowFit, planes
from pavetwin.render.tiles import Drawable, GpuPavement, GpuTile, TileCache, TileLayouts
from pavetwin.scene.light import Light
from pavetwin.scene.model import TILE_M
from pavetwin.scene.patches import COARSE_PIXEL_M
from pavetwin.scene.view import View

SHADE_FAR_M: Final = 60.0
"""Objects beyond this distance have no contact shadow."""

SHADOW_TEXELS: Final = 4.0
"""Details of shadows smaller than this are left out."""

NEAR_PX2: Final = 12.0
"""Models whose mean triangle covers more than this are lit at every pixel, others at every vertex."""


FAR_LEVEL: Final = 2
"""From this level on, with pixels of 4 cm, models that have a part for it are drawn by their part `far`."""


class GpuScene:
    """The models and tiles of one scene on the device, and the draw list of each frame."""

    def __init__(self, gpu: Gpu, scene: Drawable, layouts: TileLayouts) -> None:
        self._gpu, self._scene = gpu, scene
        self.parts = PartTable(scene.models)
        self.tiles = TileCache(gpu, scene, self.parts, layouts)
        self._meshes: dict[tuple[int, int, bool], GpuMesh] = {}
        """By part, level, and whether it is a shadow caster."""

    def mesh(self, part: int, level: int = 0, *, casts: bool = False) -> GpuMesh:
        """The mesh of a part at a level of detail; `casts`: as a shadow caster."""
        mesh, shadow = self.parts.meshes[part], self.parts.shadow.get(part)
        key = part, level, casts and (mesh.uv is not None or shadow is not None)
        if key not in self._meshes:
            seen = self.parts.far.get(part, mesh) if level >= FAR_LEVEL else mesh
            made = (shadow or casting(mesh, level)) if casts else coarser(seen, level)
            culling = FaceCulling.BACK_CULLED if part in self.parts.single_sided else culling_of(mesh)
            self._meshes[key] = upload_model(self._gpu, made, culling)
        return self._meshes[key]

    def draws(
        self,
        view: View,
        light: Light,
        shadow: ShadowFit,
        agents: tuple[InstanceBatch, InstanceBatch],
        records: InstanceBuffer,
    ) -> DrawList:
        """What is in view, and what casts shadows into it. `agents`: those drawn, and those that only cast shadows."""
        bounds = planes(view)
        tiles = [self.tiles.tile(key) for key in wanted_keys(self._scene, view, light)]
        batch = InstanceBatch.joined([*agents, *(tile.batch for tile in tiles)])
        shown, moving = len(agents[0]), len(agents[0]) + len(agents[1])
        placed = [(tile, records.add_place(tile.origin)) for tile in tiles]
        seen = [(tile, record) for tile, record in placed if tile_seen(tile.origin, view, bounds)]
        grounds = [
            (tile, self.tiles.pavement(tile.key), record)
            for tile, record in seen
            if ground_seen((*tile.origin, tile.origin[0] + TILE_M, tile.origin[1] + TILE_M), view, bounds)
        ]
        patches = self._patches(grounds, view, bounds, records)
        relative = batch.centre - view.position
        ahead = relative @ view.rotation[:, 2]
        inside = (relative @ bounds.T > -batch.radius[:, None]).all(axis=1) & (ahead - batch.radius < FAR_M)
        inside = np.asarray(inside & (batch.radius * view.focal_px > np.maximum(ahead, 0.1)))
        inside[shown:moving] = False
        across = np.abs(relative @ shadow.across.T - shadow.middle)
        throwing = np.flatnonzero((across < shadow.half_m + batch.radius[:, None]).all(axis=1))
        pixel = np.maximum(np.linalg.norm(relative, axis=1) - batch.radius, 0.5) / view.focal_px
        stretch = np.linalg.norm(batch.transform[:, :, :3], axis=1).mean(axis=1)
        area = self.parts.area_m2[batch.part] * stretch**2
        level = level_of(self.parts.least_px2[batch.part], area, pixel)
        # On average half of a triangle's area is visible.
        close = area / pixel**2 / 2 > NEAR_PX2
        near, far = (
            [
                (self.mesh(*kind), count, first)
                for kind, count, first in records.add_batch(batch.only(which), level[which])
            ]
            for which in (np.flatnonzero(inside & close), np.flatnonzero(inside & ~close))
        )
        # A few texels of the filtered shadow map correspond to one pixel of the picture.
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
        # Contact shadows reach into the picture from beside it.
        rimmed = (relative @ bounds.T > -2 * batch.radius[:, None] - 1).all(axis=1) & (ahead < SHADE_FAR_M)
        shades = records.add_shades(batch.only(np.flatnonzero(rimmed)), self.parts)
        levels = np.where(inside, level, -1)[:shown]
        down = looks_down(view, light)
        return DrawList(seen, grounds, patches, near, far, casters, shades, levels, looks_beyond(view), down)

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
