"""A frame source without a renderer: outlines of defects and boxes of agents, filled by Pillow."""

import time
from dataclasses import dataclass

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.capture.platforms import CaptureContext
from pavetwin.capture.samples import CameraSample
from pavetwin.capture.settings import CaptureSettings
from pavetwin.render.frame import Exposure, RenderedFrame
from pavetwin.scene.values import agent_label, defect_label, labelled_defect, parked_label
from pavetwin.scene.view import View

GREY = (120, 118, 112)


@dataclass
class Painter:
    """Paints what stands on the ground, the farthest first. `slow_s` is what each picture takes at least; the one after
    `tires_after` pictures never comes."""

    setting: CaptureContext
    slow_s: float = 0.0
    tires_after: int | None = None

    def frame(self, sample: CameraSample, setting: CaptureContext) -> RenderedFrame:
        time.sleep(self.slow_s)
        while self.tires_after == 0:
            time.sleep(1.0)
        if self.tires_after is not None:
            self.tires_after -= 1
        view = sample.pose.view
        labels = np.zeros((view.size_px[1], view.size_px[0]), dtype=np.uint32)
        amodal: dict[int, int] = {}
        for label, corners in [*_defects(view, setting), *_parked(sample, setting), *_agents(sample, setting)]:
            mask = _filled(view, corners)
            if mask is not None and mask.any():
                labels[mask] = label
                amodal[label] = int(mask.sum())
        rgb = np.empty((*labels.shape, 3), dtype=np.uint8)
        rgb[:] = GREY
        for label in amodal:
            # Defects are darker than the road, agents of any colour.
            shade = 0.25 if labelled_defect(label) is not None else 1.0
            rgb[labels == label] = [int(shade * ((label * factor) % 256)) for factor in (37, 91, 53)]
        defect_free = rgb.copy()
        defect_free[np.isin(labels, [label for label in amodal if labelled_defect(label) is not None])] = GREY
        return RenderedFrame(view, rgb, None, labels, amodal, Exposure(0.001, 2.8, 100.0), defect_free)


def slow_painter(setting: CaptureContext) -> Painter:
    return Painter(setting, slow_s=0.05)


def tired_painter(setting: CaptureContext) -> Painter:
    return Painter(setting, tires_after=6)


def full_disk(setting: CaptureContext) -> Painter:  # noqa: ARG001 - the signature of a frame source's factory
    raise OSError(28, "No space left on device")


def _defects(view: View, setting: CaptureContext):
    for defect in setting.world.defects:
        ring = shapely.get_coordinates(defect.polygon.exterior)
        corners = np.column_stack([ring, np.zeros(len(ring))])
        if np.linalg.norm(corners[0] - view.position) < 60:
            yield defect_label(defect.id), corners


def _parked(sample: CameraSample, setting: CaptureContext):
    stands = setting.parked(sample.conditions, sample.spec.density).near(*sample.pose.view.position[:2], 60.0)
    away = np.hypot(stands.x - sample.pose.view.position[0], stands.y - sample.pose.view.position[1])
    for row in np.argsort(-away).tolist():
        size = (stands.length_m[row], stands.width_m[row], stands.height_m[row])
        hull = _hull(sample.pose.view, (stands.x[row], stands.y[row], stands.yaw_rad[row]), size)
        if hull is not None:
            yield parked_label(int(stands.place[row])), hull


def _agents(sample: CameraSample, setting: CaptureContext):
    poses = setting.traces[sample.spec.density].agents_at(sample.pose.time_s)
    away = np.hypot(poses["x_m"] - sample.pose.view.position[0], poses["y_m"] - sample.pose.view.position[1])
    for row in np.argsort(-away).tolist():
        if int(poses["agent"][row]) == sample.pose.ego or away[row] > 60:
            continue
        place, size = (
            tuple(poses[name][row] for name in names)
            for names in (("x_m", "y_m", "yaw_rad"), ("length_m", "width_m", "height_m"))
        )
        hull = _hull(sample.pose.view, place, size)
        if hull is not None:
            yield agent_label(int(poses["agent"][row])), hull


def _hull(view: View, place: tuple[float, ...], size: tuple[float, ...]) -> shapely.Geometry | None:
    """The outline of a box (x, y, yaw; length, width, height) in the image, if all of it is ahead of the camera."""
    x, y, yaw = place
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0]) * size[0] / 2
    left = np.array([-np.sin(yaw), np.cos(yaw), 0.0]) * size[1] / 2
    base, up = np.array([x, y, 0.0]), np.array([0.0, 0.0, size[2]])
    corners = [base + a * ahead + b * left + c * up for a in (-1, 1) for b in (-1, 1) for c in (0, 1)]
    pixels = view.project(np.array(corners))
    return shapely.convex_hull(shapely.multipoints(pixels)) if np.isfinite(pixels).all() else None


def _filled(view: View, outline) -> np.ndarray | None:
    """The pixels (height, width) of an outline, corners in the world or a polygon in the image; None for none."""
    if isinstance(outline, np.ndarray):
        pixels = view.project(outline)
        if not np.isfinite(pixels).all() or (pixels.max(axis=0) < 0).any() or (pixels.min(axis=0) > view.size_px).any():
            return None
        outline = shapely.Polygon(pixels)
    image = Image.new("1", view.size_px)
    if isinstance(outline, shapely.Polygon) and outline.intersects(shapely.box(0, 0, *view.size_px)):
        clipped = outline.buffer(0).intersection(shapely.box(-50, -50, view.size_px[0] + 50, view.size_px[1] + 50))
        for part in shapely.get_parts(clipped):
            if isinstance(part, shapely.Polygon) and not part.is_empty:
                ImageDraw.Draw(image).polygon([tuple(point) for point in part.exterior.coords], fill=1)
    return np.array(image, dtype=bool)


UAV = CaptureSettings(
    platforms=("uav",), images=60, altitudes_m=(5.0, 6.0, 8.0), densities=("medium",), seed=3, size_px=(320, 320)
)
FEW = UAV.model_copy(update={"images": 20})
SPLITS = ("train", "val", "test")
