"""Frames of a scene: rendered by the device under sun and sky, and imaged by a camera model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import wgpu

from pavetwin.arrays import Float16Array, Float32Array, Float64Array, UInt32Array
from pavetwin.render.adapter import open_device
from pavetwin.render.amodal import AmodalAtlas, AmodalCount, AmodalObject
from pavetwin.render.frame import Exposure, RenderedFrame, meter, programme
from pavetwin.render.gpu import Gpu
from pavetwin.render.gpu_scene import GpuScene
from pavetwin.render.instances import InstanceBatch, InstanceBuffer, instance_rows
from pavetwin.render.passes import DrawList, FramePasses, Materials, RenderTargets
from pavetwin.render.pipelines import DEPTH_FORMAT, compile_pipelines
from pavetwin.render.projection import FRAME_INFO, NEAR_M, corners, fit_shadow, frame_info
from pavetwin.render.sensor import SHARP_PX, ImageProcessing, farthest_motion_px, stored_image, white_balance
from pavetwin.render.tile_cache import Drawable, group
from pavetwin.scene.foliage import leaf_levels
from pavetwin.scene.light import Light
from pavetwin.scene.values import GroundKind, Instance
from pavetwin.scene.view import View
from pavetwin.uav.cameras import Camera

ROWS: Final = 64
COLUMNS: Final = 128


def sky_levels(light: Light) -> list[Float16Array]:
    """Luminances (rows, columns, 4) in kcd/m², from the zenith in row 0 to the nadir, columns anticlockwise from west;
    and smaller ones, blurred for rougher surfaces. Below the horizon lies the light reflected by the ground."""
    down = (np.arange(ROWS) + 0.5) / ROWS * np.pi
    around = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * 2 * np.pi
    polar, turn = np.meshgrid(down, around, indexing="ij")
    directions = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    radiance = np.where(directions[..., 2:] >= 0, light.sky(directions), light.ground_radiance)
    levels = [radiance]
    while levels[-1].shape[0] > 2:
        fine = levels[-1]
        levels.append(fine.reshape(fine.shape[0] // 2, 2, fine.shape[1] // 2, 2, 3).mean(axis=(1, 3)))
    return [np.concatenate([level, np.ones((*level.shape[:2], 1))], axis=-1).astype(np.float16) for level in levels]


STYLE: Final = ImageProcessing()

_SMOOTH: Final = {"mag_filter": "linear", "min_filter": "linear", "mipmap_filter": "linear"}


@dataclass(frozen=True)
class SceneRadiance:
    """The light behind the lens and its ground truth, before the sensor."""

    radiance: Float16Array
    """(height, width, 4) linear RGB, kcd/m²; and by what the defect there multiplies its luminance, 1 elsewhere."""
    depth_m: Float32Array | None
    labels: UInt32Array | None


class Renderer:
    """Draws frames of one scene. Keep it: models and tiles stay on the device.

    Raises:
        PaveTwinError: there is no adapter to draw with.
    """

    def __init__(self, scene: Drawable) -> None:
        self.scene = scene
        self.gpu = Gpu(open_device())
        details = dict(scene.details)
        self._pipelines = compile_pipelines(self.gpu, details)
        self._gpu_scene = GpuScene(self.gpu, scene, self._pipelines.tiles)
        self._targets: RenderTargets | None = None
        self._shadows: dict[int, Any] = {}
        self._uniform = self.gpu.empty_buffer(FRAME_INFO.itemsize, wgpu.BufferUsage.UNIFORM)
        self._records = self.gpu.empty_buffer(1 << 16, wgpu.BufferUsage.VERTEX)
        self._frame = group(self.gpu, self._pipelines.frame_layout, [self._uniform_entry()])
        self._sky: tuple[Light, Any, dict[int, Any]] | None = None
        self._materials = self._upload_materials(details)
        self._atlas = AmodalAtlas(self.gpu, self._pipelines)
        self.on_step: Callable[[], None] = lambda: None
        """Called between the steps of a frame, and may raise to give it up."""

    def frame(
        self,
        view: View,
        *,
        light: Light,
        camera: Camera,
        instances: Sequence[Instance] = (),
        shadow_only: Sequence[Instance] = (),
        exposure: Exposure | None = None,
        compensation_ev: float = 0.0,
        seed: int = 0,
        style: ImageProcessing = STYLE,
        labels: bool = True,
        depth: bool = True,
        defect_free: bool = False,
        velocities: Mapping[int, npt.ArrayLike] | None = None,
    ) -> RenderedFrame:
        """One image with its ground truth.

        Args:
            view: where the camera is and how fast it moves.
            camera: its sensor, lens and shutter; the view gives the part of the sensor that is used.
            instances: what is not part of the static scene: agents, signal heads, the UAV.
            shadow_only: instances of which only the shadow is drawn: the vehicle that carries the camera.
            exposure: the camera's settings; None for automatic exposure.
            compensation_ev: exposure compensation of automatic exposure, in stops.
            seed: of the sensor's noise.
            style: parameters of the camera's image processing.
            labels: whether to return the label of every pixel, and the amodal pixels of each object.
            depth: whether to return the depth of every pixel.
            defect_free: whether to return the same image without defects.
            velocities: label of an instance → (3,) m/s, world frame; of those that move.
        """
        moving = velocities or {}
        drifts = bool(moving) or bool(np.any(view.velocity_mps))
        seen, count = self.radiance(
            view,
            instances=instances,
            shadow_only=shadow_only,
            light=light,
            velocities=moving,
            readout_s=camera.readout_s * view.size_px[1] / view.whole_px[1] if drifts else 0.0,
            truth=labels or depth or drifts,
            amodal=labels,
        )
        self.on_step()
        settings = exposure or programme(camera, meter(seen.radiance) * 2.0**compensation_ev)
        blurred = seen.depth_m is not None and _moves(view, settings, moving, seen.depth_m)
        take = partial(
            stored_image,
            view=view,
            camera=camera,
            light=light,
            exposure=settings,
            seed=seed,
            style=style,
            depth=seen.depth_m if blurred else None,
            labels=seen.labels,
            velocities=moving,
            white=white_balance(light, seen.radiance, style.adaptation),
        )
        taken = take(seen.radiance)
        self.on_step()
        repaired = take(_without_defects(seen.radiance)) if defect_free else None
        self.on_step()
        return RenderedFrame(
            view,
            taken,
            seen.depth_m if depth else None,
            seen.labels if labels else None,
            count.result() if count else {},
            settings,
            repaired,
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

    def _sized(self, size_px: tuple[int, int]) -> RenderTargets:
        if self._targets is None or self._targets.size_px != size_px:
            if self._targets is not None:
                self.gpu.free(*self._targets.resources)
            self._targets = RenderTargets(self.gpu, size_px)
        return self._targets

    def _lit(self, light: Light, shadow_px: int) -> tuple[Any, Any]:
        """The shadow map of that side, and the bind group of the frame under a light with it."""
        if shadow_px not in self._shadows:
            sampled = wgpu.TextureUsage.TEXTURE_BINDING
            self._shadows[shadow_px] = self.gpu.target((shadow_px, shadow_px), DEPTH_FORMAT, usage=sampled)
        if self._sky is None or self._sky[0] != light:
            if self._sky is not None:
                self.gpu.free(self._sky[1])
            self._sky = light, self.gpu.levelled(sky_levels(light)), {}
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

    def radiance(
        self,
        view: View,
        *,
        instances: Sequence[Instance] = (),
        shadow_only: Sequence[Instance] = (),
        light: Light,
        velocities: Mapping[int, npt.ArrayLike] | None = None,
        readout_s: float = 0.0,
        truth: bool = True,
        amodal: bool = False,
    ) -> tuple[SceneRadiance, AmodalCount | None]:
        """The light that reaches the sensor, and the started count of amodal pixels, where it is asked for.

        Args:
            truth: whether depth and labels are returned.
        """
        targets, shadow = self._sized(view.size_px), fit_shadow(view, light)
        records = InstanceBuffer(view.position)
        agents = InstanceBatch.of(instances, self._gpu_scene.parts, velocities)
        draws = self._gpu_scene.draws(
            view, light, shadow, (agents, InstanceBatch.of(shadow_only, self._gpu_scene.parts)), records
        )
        self.gpu.queue.write_buffer(self._uniform, 0, frame_info(view, light, shadow, readout_s=readout_s))
        data = records.data
        self._records = self.gpu.grown(self._records, data.nbytes, wgpu.BufferUsage.VERTEX)
        self.gpu.queue.write_buffer(self._records, 0, data.view(np.uint8))
        shaded, lit = self._lit(light, shadow.size_px)
        encoder = self.gpu.device.create_command_encoder()
        passes = FramePasses(encoder, self._pipelines, self._frame, self._materials, self._records, draws)
        passes.shadows(shaded, shadow.used_px)
        passes.light(targets, lit)
        targets.copy(encoder, truth=truth)
        self.gpu.queue.submit([encoder.finish()])
        count = None
        if amodal:
            speed = float(np.linalg.norm(view.velocity_mps)) + float(np.abs(agents.velocity).sum(axis=1).max(initial=0))
            margin = 2 + speed * readout_s * view.focal_px / 2
            count = self._atlas.count(self._amodal_objects(view.position, agents, draws), view, self._frame, margin)
        seen = SceneRadiance(*targets.read(truth=truth))
        if count:
            count.start()
        self._gpu_scene.tiles.trim(len(draws.tiles), len(draws.grounds))
        return seen, count

    def _amodal_objects(self, camera: Float64Array, agents: InstanceBatch, draws: DrawList) -> list[AmodalObject]:
        """The labelled objects that may be in the image, with the meshes that they are drawn with."""
        objects, parts = [], self._gpu_scene.parts
        seen = np.flatnonzero((agents.label > 0) & (draws.levels >= 0))
        shown = agents.only(seen)
        rows = instance_rows(shown, camera)
        for number, level in enumerate(draws.levels[seen].tolist()):
            part, transform = int(shown.part[number]), shown.transform[number]
            placed = corners(parts.low[part], parts.high[part]) @ transform[:, :3].T + transform[:, 3]
            objects.append(
                AmodalObject(
                    int(shown.label[number]),
                    self._gpu_scene.mesh(part, level),
                    rows[number : number + 1],
                    placed,
                    single_sided=part in parts.single_sided,
                )
            )
        for each in draws.patches:
            patch, records = each.patch, InstanceBuffer(camera)
            records.add_place(each.origin, label=patch.label)
            placed = corners(each.mesh.low, each.mesh.high) + (*each.origin, 0.0)
            objects.append(AmodalObject(patch.label, each.mesh, records.data, placed, patch.masked))
        return objects


def _without_defects(radiance: Float16Array) -> Float16Array:
    """The same radiance without defects."""
    repaired = radiance.copy()
    where = np.nonzero(radiance[..., 3] != 1)
    repaired[where] = radiance[where] / np.maximum(radiance[where][..., 3:], np.float16(1e-3))
    return repaired


def _moves(view: View, exposure: Exposure, velocities: Mapping[int, npt.ArrayLike], depth: Float32Array) -> bool:
    """Whether anything moves visibly during the exposure."""
    nearest = max(float(depth.min()), NEAR_M)
    return farthest_motion_px(view, exposure, velocities, nearest) > SHARP_PX
