"""The labelled objects of one image, from its instance image; and which of them are ignored, and why."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from math import hypot
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.capture.classes import Category, category_of_agent, category_of_defect
from pavetwin.capture.contrast import ContrastMeter
from pavetwin.capture.defect_index import footprint
from pavetwin.capture.instance_masks import InstanceMask, PixelBox, instance_masks
from pavetwin.capture.rle import encode
from pavetwin.render.frame import RenderedFrame
from pavetwin.scene.model import labelled_agent, labelled_defect
from pavetwin.scene.view import View
from pavetwin.world.model import Defect, World

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns

LEAST_VISIBLE_SHARE: Final = 0.15
LEAST_INSIDE_SHARE: Final = 0.15
LARGE_PX_SHARE: Final = 0.01
"""Share of the image: an object whose visible part is larger is labelled, however much of it lies outside."""


class Reason(StrEnum):
    """Why a visible object is not labelled. The first reason that holds is given."""

    HIDDEN = "hidden"
    """Less than 15 % of what the image would show of it without occlusion is visible."""
    CUT = "cut"
    """Less than 15 % of it lies within the image, and its visible part is less than 1 % of the image."""
    FAR = "far"
    SMALL = "small"
    """A side of its box, or its mask, is below the class's least size."""
    FAINT = "faint"
    """A defect that is hardly visible: its contrast is below the class's least."""


@dataclass(frozen=True)
class LabelledObject:
    """One defect or agent in one image."""

    id: str
    """`defect 12`, or `agent 7` of the image's recording."""
    category: str
    box: PixelBox
    """Tight around its visible pixels: left, top, and the first column and row beyond it."""
    area_px: int
    """Its visible pixels."""
    amodal_px: int
    """Pixels of this image that it would cover without occlusion."""
    visible_fraction: float
    """area_px / amodal_px."""
    inside_fraction: float | None
    """Share within the image: of a defect's area on the road; of an agent's outline in the image plane, None where a
    part of it is behind the camera."""
    truncated: bool
    """It reaches the image's border."""
    distance_m: float
    """From the camera to its centre."""
    position_m: tuple[float, float, float]
    """Its centre, in the world frame."""
    details: dict[str, Any]
    """Of defects: class, severity, width_m, depth_m, area_m2, segment, street, contrast. Of agents: kind, sizes, yaw,
    speed."""
    ignored: str | None
    """A `Reason`; None for what is labelled."""
    mask: str
    """COCO's compressed run lengths over the whole image."""

    def as_dict(self) -> dict[str, Any]:
        return asdict(self) | {"box": list(self.box), "position_m": list(self.position_m)}


@dataclass(frozen=True)
class SceneState:
    """A world, and the agents in it at one time."""

    world: World
    agents: "PoseColumns"
    kinds: Sequence[str]
    """Kind of each agent of the recording, by number."""


def labelled_objects(frame: RenderedFrame, state: SceneState) -> list[LabelledObject]:
    """The objects that a frame's instance image shows, by ascending label.

    Raises:
        ValueError: the frame has no labels or no defect-free image, or a label that matches no object.
    """
    if frame.labels is None or frame.defect_free is None:
        raise ValueError("labelled objects need a frame with labels and with its defect-free image")
    contrast_meter = ContrastMeter(frame.rgb, frame.defect_free, frame.labels)
    return [_labelled_object(instance, frame, contrast_meter, state) for instance in instance_masks(frame.labels)]


def _labelled_object(
    instance: InstanceMask, frame: RenderedFrame, contrast_meter: ContrastMeter, state: SceneState
) -> LabelledObject:
    number = labelled_defect(instance.label)
    inside: float | None
    is_faint = False
    if number is not None:
        defect = state.world.defects[number]
        category, middle, details = _defect(state, defect)
        name, inside = f"defect {number}", ground_fraction(frame.view, defect.polygon)
        contrast = contrast_meter.contrast(instance)
        details["contrast"] = round(contrast, 3)
        is_faint = contrast < category.least_contrast
    else:
        agent = labelled_agent(instance.label)
        assert agent is not None
        category, corners, middle, details = _agent(state, agent)
        name, inside = f"agent {agent}", inside_fraction(frame.view, corners)
    amodal_px = frame.amodal_px[instance.label]
    size = (frame.view.size_px[1], frame.view.size_px[0])
    distance = float(np.linalg.norm(middle - frame.view.position))
    visible = instance.area_px / amodal_px
    is_small = instance.area_px < LARGE_PX_SHARE * size[0] * size[1]
    is_cut = inside is not None and inside < LEAST_INSIDE_SHARE and is_small
    return LabelledObject(
        id=name,
        category=category.name,
        box=instance.box,
        area_px=instance.area_px,
        amodal_px=amodal_px,
        visible_fraction=round(visible, 4),
        inside_fraction=None if inside is None else round(inside, 4),
        truncated=instance.touches_border(size),
        distance_m=round(distance, 3),
        position_m=(round(float(middle[0]), 3), round(float(middle[1]), 3), round(float(middle[2]), 3)),
        details=details,
        ignored=_reason(instance, category, visible, is_cut, distance, is_faint),
        mask=encode(instance.mask(size)),
    )


def _reason(
    instance: InstanceMask, category: Category, visible: float, is_cut: bool, distance_m: float, is_faint: bool
) -> str | None:
    if visible < LEAST_VISIBLE_SHARE:
        return Reason.HIDDEN.value
    if is_cut:
        return Reason.CUT.value
    if distance_m > category.farthest_m:
        return Reason.FAR.value
    longer, shorter = instance.sides_px
    is_short = longer < category.least_side_px or shorter < category.least_short_side_px
    if is_short or instance.area_px < category.least_area_px:
        return Reason.SMALL.value
    return Reason.FAINT.value if is_faint else None


def _defect(state: SceneState, defect: Defect) -> tuple[Category, Float64Array, dict[str, Any]]:
    """Category, middle (3,), details."""
    details = defect.facts | {"street": state.world.segment(defect.segment).street_name}
    return category_of_defect(defect.kind), np.array([defect.centre.x, defect.centre.y, 0.0]), details


def _agent(state: SceneState, agent: int) -> tuple[Category, Float64Array, Float64Array, dict[str, Any]]:
    """Category, corners (8, 3), middle (3,), details."""
    poses = state.agents
    there = np.flatnonzero(poses["agent"] == agent)
    if not len(there):
        raise ValueError(f"the instance image shows agent {agent}, who is not there at this time")
    row = int(there[0])
    x, y, yaw = float(poses["x_m"][row]), float(poses["y_m"][row]), float(poses["yaw_rad"][row])
    length, width, height = (float(poses[name][row]) for name in ("length_m", "width_m", "height_m"))
    details = {
        "kind": state.kinds[agent],
        "length_m": round(length, 3),
        "width_m": round(width, 3),
        "height_m": round(height, 3),
        "yaw_rad": round(yaw, 4),
        "speed_mps": round(hypot(float(poses["east_mps"][row]), float(poses["north_mps"][row])), 3),
    }
    category = category_of_agent(is_pedestrian=bool(poses["is_pedestrian"][row]))
    return category, _box_corners(x, y, yaw, length, width, height), np.array([x, y, height / 2]), details


def _box_corners(x: float, y: float, yaw_rad: float, length_m: float, width_m: float, height_m: float) -> Float64Array:
    """The corners (8, 3) of an agent's bounding box on the ground."""
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0]) * length_m / 2
    left = np.array([-np.sin(yaw_rad), np.cos(yaw_rad), 0.0]) * width_m / 2
    base = [a * ahead + b * left for a in (-1, 1) for b in (-1, 1)]
    return np.array([np.array([x, y, z]) + corner for corner in base for z in (0.0, height_m)])


def ground_fraction(view: View, outline: Polygon) -> float:
    """Fraction of an area on the ground that lies within the image."""
    return float(outline.intersection(footprint(view)).area / outline.area)


def inside_fraction(view: View, corners: Float64Array) -> float | None:
    """Fraction of an object's outline in the image plane that lies within the image.

    Args:
        corners: (n, 3) in the world frame; the outline is their hull's.

    Returns:
        None if a corner is behind the camera, or if all lie on a line.
    """
    pixels = view.project(corners)
    if not np.isfinite(pixels).all():
        return None
    outline = shapely.convex_hull(shapely.multipoints(pixels))
    if not isinstance(outline, Polygon):
        return None
    width, height = view.size_px
    return float(outline.intersection(shapely.box(0, 0, width, height)).area / outline.area)
