"""Frames of a scene: what is near is gathered, drawn by the device, and seen through a camera."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import wgpu

from pavetwin.render.adapter import open_device
from pavetwin.render.alone import Atlas, Lone
from pavetwin.render.boxes import solids
from pavetwin.render.exposure import Exposure, meter, programme
from pavetwin.render.frame import Frame
from pavetwin.render.gpu import Gpu
from pavetwin.render.instances import Crowd, Parts, Records
from pavetwin.render.levels import casting, coarser, level_of, skin_of
from pavetwin.render.meshes import GpuMesh, upload_model
from pavetwin.render.nearby import FAR_M, ground_seen, looks_beyond, looks_down, tile_seen, wanted_keys
from pavetwin.render.passes import (
    Draws,
    Materials,
    PatchDraw,
    Targets,
    draw_light,
    draw_shadows,
    draw_truth,
    read,
    shadow_map,
)
from pavetwin.render.pipelines import compile_pipelines
from pavetwin.render.projection import (
    FRAME_INFO,
    NEAR_M,
    ShadowFit,
    corners,
    fit_shadow,
    frame_info,
    planes,
)
from pavetwin.render.sensor import SHARP_PX, Style, farthest_motion_px, picture
from pavetwin.render.sky import sky_levels
from pavetwin.render.tiles import Drawable, TileCache, group
from pavetwin.scene.foliage import leaf_levels
from pavetwin.scene.light import Light
from pavetwin.scene.model import TILE_M, Float64, GroundKind, Instance
from pavetwin.scene.patches import COARSE_PIXEL_M
from pavetwin.scene.view import View
from pavetwin.uav.cameras import Camera

STYLE: Final = Style()

SHADE_FAR_M: Final = 60.0
"""Farther things do not darken the ground around them."""

SHADOW_TEXELS: Final = 4.0
"""Details of shadows smaller than this are left out."""

NEAR_PX2: Final = 12.0
"""Models whose mean triangle covers more than this are lit at every pixel, others at every vertex."""

_SMOOTH: Final = {"mag_filter": "linear", "min_filter": "linear", "mipmap_filter": "linear"}


@dataclass(frozen=True)
class Seen:
    """What the lens lets through and where it came from, before the sensor."""

    radiance: npt.NDArray[np.float16]
    """(height, width, 4) linear RGB, kcd/m²."""
    depth_m: npt.NDArray[np.float32] | None
    labels: npt.NDArray[np.uint32] | None
    alone_px: dict[int, int]


class Renderer:
    """Draws frames of one scene. Keep it: models and tiles stay on the device.

    Raises:
        PaveTwinError: there is no adapter to draw with.
    """

    def __init__(self, scene: Drawable) -> None:
        self.scene = scene
        self.gpu = Gpu(open_device())
        self._parts = Parts({**scene.models, **solids()})
        self._meshes: dict[tuple[int, int, bool], GpuMesh] = {}
        """By part, level, and whether it is of those that only throw shadows."""
        details = dict(scene.details)
        self._pipelines = compile_pipelines(self.gpu, details)
        self._tiles = TileCache(self.gpu, scene, self._parts, self._pipelines.tiles)
        self._targets: Targets | None = None
        self._shadows: dict[int, Any] = {}
        self._uniform = self.gpu.empty_buffer(FRAME_INFO.itemsize, wgpu.BufferUsage.UNIFORM)
        self._records = self.gpu.empty_buffer(1 << 16, wgpu.BufferUsage.VERTEX)
        self._frame = group(self.gpu, self._pipelines.frame_layout, [self._uniform_entry()])
        self._sky: tuple[Light, Any, dict[int, Any]] | None = None
        self._materials = self._upload_materials(details)
        self._atlas = Atlas(self.gpu, self._pipelines)

    def frame(
        self,
        view: View,
        *,
        light: Light,
        camera: Camera,
        instances: Sequence[Instance] = (),
        unseen: Sequence[Instance] = (),
        exposure: Exposure | None = None,
        compensation_ev: float = 0.0,
        seed: int = 0,
        style: Style = STYLE,
        labels: bool = True,
        depth: bool = True,
        velocities: Mapping[int, npt.ArrayLike] | None = None,
    ) -> Frame:
        """One picture with its truth.

        Args:
            view: where the camera is and how fast it moves.
            light: sun and sky.
            camera: its sensor, lens and shutter; the view tells what part of the sensor is used.
            instances: what is not the scene's own: agents, signal heads, the UAV.
            unseen: what only throws its shadow into the picture: the vehicle that carries the camera.
            exposure: the camera's settings; None lets it choose.
            compensation_ev: how much brighter than metered it then chooses, in stops.
            seed: of the sensor's noise.
            style: of the camera's own processing.
            labels: whether to tell what every pixel shows, and what each thing would cover alone.
            depth: whether to tell how far away it is.
            velocities: label of an instance → (3,) m/s, world frame; of those that move.
        """
        moving = velocities or {}
        drifts = bool(moving) or bool(np.any(view.velocity_mps))
        seen = self.light(
            view,
            instances=instances,
            unseen=unseen,
            light=light,
            velocities=moving,
            readout_s=camera.readout_s if drifts else 0.0,
            truth=labels or depth or drifts,
            alone=labels,
        )
        settings = exposure or programme(camera, meter(seen.radiance) * 2.0**compensation_ev)
        blurred = seen.depth_m is not None and _moves(view, settings, moving, seen.depth_m)
        rgb = picture(
            seen.radiance,
            view=view,
            camera=camera,
            light=light,
            exposure=settings,
            seed=seed,
            style=style,
            depth=seen.depth_m if blurred else None,
            labels=seen.labels,
            velocities=moving,
        )
        return Frame(
            view, rgb, seen.depth_m if depth else None, seen.labels if labels else None, seen.alone_px, settings
        )

    def _uniform_entry(self) -> dict[str, Any]:
        return {"buffer": self._uniform, "offset": 0, "size": FRAME_INFO.itemsize}

    def _upload_materials(self, details: Mapping[GroundKind, Any]) -> Materials:
        in_order = [details[kind] for kind in GroundKind]
        colour = self.gpu.texture([detail.reflectance for detail in in_order], rooted=True)
        relief = self.gpu.texture([detail.relief for detail in in_order])
        facades = self.gpu.texture(list(self.scene.facade_textures), srgb=True)
        repeat = self.gpu.device.create_sampler(**_SMOOTH, address_mode_u="repeat", address_mode_v="repeat")
        leaves = self.gpu.levelled(leaf_levels()).create_view()
        views = [texture.create_view(dimension="2d-array") for texture in (colour, relief, facades)]
        return Materials(
            ground=group(self.gpu, self._pipelines.detail_layout, [views[0], views[1], repeat]),
            facades=group(self.gpu, self._pipelines.facade_layout, [views[2], repeat]),
            leaves=group(
                self.gpu,
                self._pipelines.leaf_layout,
                [leaves, self.gpu.device.create_sampler(**_SMOOTH | {"mipmap_filter": "nearest"})],
            ),
        )

    def _mesh(self, part: int, level: int = 0, *, casts: bool = False) -> GpuMesh:
        mesh = self._parts.meshes[part]
        key = part, level, casts and mesh.uv is not None
        if key not in self._meshes:
            made = casting(mesh, level) if casts else coarser(mesh, level)
            self._meshes[key] = upload_model(self.gpu, made, skin_of(mesh))
        return self._meshes[key]

    def _sized(self, size_px: tuple[int, int]) -> Targets:
        if self._targets is None or self._targets.size_px != size_px:
            if self._targets is not None:
                self.gpu.free(*self._targets.textures)
            self._targets = Targets(self.gpu, size_px)
        return self._targets

    def _lit(self, light: Light, shadow_px: int) -> tuple[Any, Any]:
        """The shadow map of that side, and the bind group of the frame under a light with it."""
        if shadow_px not in self._shadows:
            self._shadows[shadow_px] = shadow_map(self.gpu, shadow_px)
        if self._sky is None or self._sky[0] != light:
            if self._sky is not None:
                self.gpu.free(self._sky[1])
            self._sky = light, self.gpu.half_floats(sky_levels(light)), {}
        _, sky, groups = self._sky
        if shadow_px not in groups:
            device = self.gpu.device
            resources = [
                self._uniform_entry(),
                self._shadows[shadow_px].create_view(),
                device.create_sampler(compare="less-equal", mag_filter="linear", min_filter="linear"),
                sky.create_view(),
                device.create_sampler(**_SMOOTH),
                device.create_sampler(**_SMOOTH, address_mode_u="repeat"),
                device.create_sampler(),
            ]
            groups[shadow_px] = group(self.gpu, self._pipelines.light_layout, resources)
        return self._shadows[shadow_px], groups[shadow_px]

    def light(
        self,
        view: View,
        *,
        instances: Sequence[Instance] = (),
        unseen: Sequence[Instance] = (),
        light: Light,
        velocities: Mapping[int, npt.ArrayLike] | None = None,
        readout_s: float = 0.0,
        truth: bool = True,
        alone: bool = False,
    ) -> Seen:
        """What reaches the sensor from all that is seen."""
        targets, shadow = self._sized(view.size_px), fit_shadow(view, light)
        records = Records(view.position)
        agents = Crowd.of(instances, self._parts, velocities)
        draws = self._gather(view, light, shadow, (agents, Crowd.of(unseen, self._parts)), records)
        self.gpu.queue.write_buffer(self._uniform, 0, frame_info(view, light, shadow, readout_s=readout_s))
        self._write_records(records)
        shaded, lit = self._lit(light, shadow.size_px)
        encoder, leaves = self.gpu.device.create_command_encoder(), self._materials.leaves
        used, casters = shadow.used_px, draws.casters
        draw_shadows(encoder, self._pipelines, self._frame, leaves, self._records, shaded, used, casters)
        draw_light(encoder, self._pipelines, lit, self._materials, self._records, targets, draws)
        if truth:
            draw_truth(encoder, self._pipelines, self._frame, leaves, self._records, targets, draws)
        self.gpu.queue.submit([encoder.finish()])
        counted: dict[int, int] = {}
        if alone:
            speed = float(np.linalg.norm(view.velocity_mps)) + float(np.abs(agents.velocity).sum(axis=1).max(initial=0))
            margin = 2 + speed * readout_s * view.focal_px / 2
            counted = self._atlas.count(self._lone(view.position, agents, draws), view, self._frame, margin)
        self._tiles.trim(len(draws.tiles), len(draws.grounds))
        size = view.size_px
        return Seen(
            read(self.gpu, targets.light, size, np.float16, 4),
            read(self.gpu, targets.distances, size, np.float32, 1) if truth else None,
            read(self.gpu, targets.labels, size, np.uint32, 1) if truth else None,
            counted,
        )

    def _lone(self, camera: Float64, agents: Crowd, draws: Draws) -> list[Lone]:
        """Everything labelled that may be in the picture, by the meshes that it is drawn with."""
        things = []
        for row in np.flatnonzero((agents.label > 0) & (draws.levels >= 0)):
            one, records = agents.only(np.array([row])), Records(camera)
            records.add_crowd(one)
            part = int(one.part[0])
            box = corners(self._parts.low[part], self._parts.high[part])
            placed = box @ one.transform[0, :, :3].T + one.transform[0, :, 3]
            mesh = self._mesh(part, int(draws.levels[row]))
            things.append(Lone(int(one.label[0]), mesh, records.data, placed))
        for each in draws.patches:
            patch, records = each.patch, Records(camera)
            records.add_place(each.origin, label=patch.label)
            placed = corners(each.mesh.low, each.mesh.high) + (*each.origin, 0.0)
            things.append(Lone(patch.label, each.mesh, records.data, placed, patch.truth))
        return things

    def _write_records(self, records: Records) -> None:
        data = records.data
        if data.nbytes > self._records.size:
            self.gpu.free(self._records)
            self._records = self.gpu.empty_buffer(2 * data.nbytes, wgpu.BufferUsage.VERTEX)
        self.gpu.queue.write_buffer(self._records, 0, data.view(np.uint8))

    def _gather(
        self, view: View, light: Light, shadow: ShadowFit, agents: tuple[Crowd, Crowd], records: Records
    ) -> Draws:
        """What is seen, and what throws shadows on it. Of the agents the second ones do nothing but that."""
        bounds = planes(view)
        tiles = [self._tiles.tile(key) for key in wanted_keys(self.scene, view, light)]
        crowd = Crowd.joined([*agents, *(tile.crowd for tile in tiles)])
        shown, moving = len(agents[0]), len(agents[0]) + len(agents[1])
        placed = [(tile, records.add_place(tile.origin)) for tile in tiles]
        seen = [(tile, record) for tile, record in placed if tile_seen(tile.origin, view, bounds)]
        grounds = [
            (tile, self._tiles.pavement(tile.key), record)
            for tile, record in seen
            if ground_seen((*tile.origin, tile.origin[0] + TILE_M, tile.origin[1] + TILE_M), view, bounds)
        ]
        filled = [
            (tile, pavement, self._tiles.patch(tile, number), _pixel_m(box, view))
            for tile, pavement, _ in grounds
            for number, box in self.scene.holes_on(tile.key).items()
            if ground_seen(box, view, bounds)
        ]
        patches = [
            PatchDraw(
                patch,
                patch.coarse if pixel_m >= COARSE_PIXEL_M else patch.mesh,
                pavement,
                tile.origin,
                records.add_place(tile.origin, label=patch.label),
            )
            for tile, pavement, patch, pixel_m in filled
            if patch is not None
        ]
        relative = crowd.centre - view.position
        ahead = relative @ view.rotation[:, 2]
        inside = (relative @ bounds.T > -crowd.radius[:, None]).all(axis=1) & (ahead - crowd.radius < FAR_M)
        inside = np.asarray(inside & (crowd.radius * view.focal_px > np.maximum(ahead, 0.1)))
        inside[shown:moving] = False
        across = np.abs(relative @ shadow.across.T - shadow.middle)
        throwing = np.flatnonzero((across < shadow.half_m + crowd.radius[:, None]).all(axis=1))
        pixel = np.maximum(np.linalg.norm(relative, axis=1) - crowd.radius, 0.5) / view.focal_px
        stretch = np.linalg.norm(crowd.transform[:, :, :3], axis=1).mean(axis=1)
        area = self._parts.area_m2[crowd.part] * stretch**2
        level = level_of(self._parts.least_px2[crowd.part], area, pixel)
        # Half of a triangle's area is seen on average.
        close = area / pixel**2 / 2 > NEAR_PX2
        near, far = (
            [
                (self._mesh(*kind), count, first)
                for kind, count, first in records.add_crowd(crowd.only(which), level[which])
            ]
            for which in (np.flatnonzero(inside & close), np.flatnonzero(inside & ~close))
        )
        # A few texels of the shadow map, which is smoothed, are to shadows what a pixel is to the picture.
        coarse = np.maximum(pixel, SHADOW_TEXELS * shadow.texel_m)
        # The camera's own vehicle throws its shadow right before the lens, where four texels are a wide tooth.
        coarse[shown:moving] = pixel[shown:moving]
        shade_level = level_of(self._parts.least_px2[crowd.part], area, coarse)
        casters = [
            (self._mesh(*kind, casts=True), count, first)
            for kind, count, first in records.add_crowd(crowd.only(throwing), shade_level[throwing])
        ]
        for tile, record in placed:
            casters += [(mesh, 1, record) for mesh in (tile.facades, tile.kerbs) if mesh is not None]
        # Their rims reach into the picture from beside it.
        rimmed = (relative @ bounds.T > -2 * crowd.radius[:, None] - 1).all(axis=1) & (ahead < SHADE_FAR_M)
        shades = records.add_shades(crowd.only(np.flatnonzero(rimmed)), self._parts)
        levels = np.where(inside, level, -1)[:shown]
        down = looks_down(view, light)
        return Draws(seen, grounds, patches, near, far, casters, shades, levels, looks_beyond(view), down)


def _pixel_m(box: tuple[float, float, float, float], view: View) -> float:
    """Side of a pixel at the nearest place of a box on the ground."""
    west, south, east, north = box
    nearest = np.clip(view.position, (west, south, 0.0), (east, north, 0.0))
    return float(np.linalg.norm(nearest - view.position)) / view.focal_px


def _moves(
    view: View, exposure: Exposure, velocities: Mapping[int, npt.ArrayLike], depth: npt.NDArray[np.float32]
) -> bool:
    """Whether anything moves far enough over the exposure to be seen to."""
    nearest = max(float(depth.min()), NEAR_M)
    return farthest_motion_px(view, exposure, velocities, nearest) > SHARP_PX
