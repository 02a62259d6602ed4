"""Labelled objects of an image: their masks, contrast, visible share, and the reasons to ignore them.

How clearly a defect stands out is measured against the same image of defect-free pavement. Width and depth do not
decide it: a fine crack shows in low sun, and a wide one vanishes in coarse texture. The image alone does not decide it
either: a joint, a marking or a shadow edge next to a defect is not part of it. The contrast is the change that the
defect makes to the image, in units of the variation of the pavement there, pooled over all of its pixels.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property
from math import hypot
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
import numpy.typing as npt
import shapely
from shapely import Polygon

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, IndexArray, UInt8Array, UInt32Array
from pavetwin.capture.image_spec import footprint
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.classes import Category, category_of_agent, category_of_defect
from pavetwin.labels.rle import encode
from pavetwin.render.frame import RenderedFrame
from pavetwin.scene.light import LUMINANCE
from pavetwin.scene.values import labelled_agent, labelled_defect, labelled_place
from pavetwin.scene.view import View
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import Defect, World

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns


@dataclass(frozen=True)
class InstanceMask:
    """The visible pixels of one object in one image."""

    label: int
    box: PixelBox
    bits: BoolArray
    """(bottom − top, right − left): which pixels of the box show it. Each edge of the box has at least one."""

    @property
    def area_px(self) -> int:
        return int(self.bits.sum())

    @property
    def sides_px(self) -> tuple[int, int]:
        """The longer and the shorter side of the box."""
        return max(self.bits.shape), min(self.bits.shape)

    def mask(self, size: tuple[int, int]) -> BoolArray:
        """The mask in the whole image (height, width)."""
        mask = np.zeros(size, dtype=np.bool_)
        left, top, right, bottom = self.box
        mask[top:bottom, left:right] = self.bits
        return mask

    def touches_border(self, size: tuple[int, int]) -> bool:
        """Return whether it reaches the border of an image (height, width), where it may be cut off."""
        left, top, right, bottom = self.box
        return left == 0 or top == 0 or right == size[1] or bottom == size[0]


def instance_masks(labels: UInt32Array) -> list[InstanceMask]:
    """One mask for each label of an instance image (height, width), in ascending order; 0 is background."""
    where = np.flatnonzero(labels)
    if not len(where):
        return []
    values = labels.ravel()[where]
    order = np.argsort(values, kind="stable")
    values, where = values[order], where[order]
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    return [
        _instance_mask(int(values[start]), places, labels.shape[1])
        for start, places in zip(starts, np.split(where, starts[1:]), strict=True)
    ]


def _instance_mask(label: int, places: IndexArray, width: int) -> InstanceMask:
    rows, columns = np.divmod(places, width)
    top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
    bits = np.zeros((bottom - top, right - left), dtype=np.bool_)
    bits[rows - top, columns - left] = True
    return InstanceMask(label, (int(left), int(top), int(right), int(bottom)), bits)


REACH_PX = 2  # The lens, sharpening and motion spread a defect's change this far beyond its mask

POOLING = 3.0
"""Minkowski exponent of the sum over pixels: near the slope of the psychometric function, by which the probabilities of
seeing any one part add up (Quick 1974, A vector-magnitude model of contrast detection; Watson 1979, Probability
summation over time). A sum of squares would count faint haze over a wide area as visible."""

_GROUND_PX = 11  # Side of the window of the local mean: slower variation of the pavement masks no defect
_QUARTILES = 1.349  # Standard deviations between the quartiles of a normal distribution
_LEAST_SPREAD = 0.5  # In grey levels of 255: the variation that rounding leaves on a uniform surface

_LUMA = LUMINANCE.astype(np.float32)


class ContrastMeter:
    """Measures the contrast of the defects in one image, from its instance image and its defect-free version."""

    def __init__(self, rgb: UInt8Array, defect_free: UInt8Array, labels: UInt32Array) -> None:
        """All of the same height and width; `defect_free` as `RenderedFrame.defect_free`."""
        self._rgb, self._defect_free, self._labels = rgb, defect_free, labels

    def contrast(self, instance: InstanceMask) -> float:
        """Contrast of an instance, in standard deviations of defect-free pavement."""
        left, top, right, bottom = instance.box
        height, width = self._labels.shape
        rows = slice(max(0, top - REACH_PX), min(height, bottom + REACH_PX))
        columns = slice(max(0, left - REACH_PX), min(width, right + REACH_PX))
        labels = self._labels[rows, columns]
        here = labels == instance.label
        reached = _beside(here) & ((labels == 0) | here)
        pavement = self._grain[rows, columns][reached]
        # By quartiles, so that a marking or shadow edge that crosses the defect does not count as texture.
        low, high = np.quantile(pavement, (0.25, 0.75))
        change = np.abs(self._change[rows, columns][reached])
        return float(np.sum(change**POOLING) ** (1 / POOLING) / max((high - low) / _QUARTILES, _LEAST_SPREAD))

    @cached_property
    def _luma(self) -> Float32Array:
        return np.asarray(self._defect_free.astype(np.float32) @ _LUMA, dtype=np.float32)

    @cached_property
    def _change(self) -> Float32Array:
        """Change of each pixel's luma by defects."""
        return np.asarray(self._rgb.astype(np.float32) @ _LUMA - self._luma, dtype=np.float32)

    @cached_property
    def _grain(self) -> Float32Array:
        """Luma of the defect-free pavement less its local mean."""
        mean = cv2.blur(self._luma, (_GROUND_PX, _GROUND_PX), borderType=cv2.BORDER_REPLICATE)
        return np.asarray(self._luma - mean, dtype=np.float32)


def _beside(mask: BoolArray) -> BoolArray:
    """The mask and all within a square of `REACH_PX` around it."""
    square = np.ones((2 * REACH_PX + 1, 2 * REACH_PX + 1), dtype=np.uint8)
    return cv2.dilate(mask.astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0


LEAST_VISIBLE_SHARE: Final = 0.15
LEAST_INSIDE_SHARE: Final = 0.15
LARGE_PX_SHARE: Final = 0.01
"""Share of the image: an object whose visible part is larger is labelled, however much of it lies outside."""

FAR_FOCAL_PX: Final = 1500.0
"""Up to this focal length a class's greatest distance holds; longer lenses see farther in proportion."""


class Reason(StrEnum):
    """Reasons to ignore a visible object; the first that applies is recorded."""

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
    """`defect 12`, `agent 7` of the image's recording, or `parked 31`: what stands in that parking place."""
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
    """For defects: class, severity, width_m, depth_m, length_m, area_m2, segment, street, contrast. For agents: kind,
    sizes, yaw, speed. For parked vehicles these, that they are `parked`, and the `place`."""
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
    parked: ParkedVehicles = field(default_factory=ParkedVehicles.empty)


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
        name, body, category, details = _vehicle_or_person(state, instance.label)
        middle, inside = body.middle, inside_fraction(frame.view, body.corners)
    # What is seen of a thing a few pixels large may be more than its amodal pass draws, which samples other places.
    amodal_px = max(instance.area_px, frame.amodal_px[instance.label])
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
        ignored=_reason(instance, category, visible, is_cut, distance, frame.view.focal_px, is_faint),
        mask=encode(instance.mask(size)),
    )


def _reason(
    instance: InstanceMask,
    category: Category,
    visible: float,
    is_cut: bool,
    distance_m: float,
    focal_px: float,
    is_faint: bool,
) -> str | None:
    if visible < LEAST_VISIBLE_SHARE:
        return Reason.HIDDEN.value
    if is_cut:
        return Reason.CUT.value
    if distance_m > max(category.farthest_m, category.farthest_m / FAR_FOCAL_PX * focal_px):
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


@dataclass(frozen=True, slots=True)
class _Body:
    """The box of an agent or a parked vehicle on the ground."""

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float

    @property
    def middle(self) -> Float64Array:
        """(3,)"""
        return np.array([self.x_m, self.y_m, self.height_m / 2])

    @property
    def corners(self) -> Float64Array:
        """(8, 3)"""
        ahead = np.array([np.cos(self.yaw_rad), np.sin(self.yaw_rad), 0.0]) * self.length_m / 2
        left = np.array([-np.sin(self.yaw_rad), np.cos(self.yaw_rad), 0.0]) * self.width_m / 2
        base = [a * ahead + b * left for a in (-1, 1) for b in (-1, 1)]
        return np.array([np.array([self.x_m, self.y_m, z]) + corner for corner in base for z in (0.0, self.height_m)])

    def details(self, kind: str, speed_mps: float) -> dict[str, Any]:
        return {
            "kind": kind,
            "length_m": round(self.length_m, 3),
            "width_m": round(self.width_m, 3),
            "height_m": round(self.height_m, 3),
            "yaw_rad": round(self.yaw_rad, 4),
            "speed_mps": round(speed_mps, 3),
        }


def _vehicle_or_person(state: SceneState, label: int) -> tuple[str, _Body, Category, dict[str, Any]]:
    """Id, body, category, details."""
    place, agent = labelled_place(label), labelled_agent(label)
    if place is not None:
        row = _row(state.parked.place, place, f"a vehicle parked in place {place}")
        body = _Body(
            *(float(getattr(state.parked, name)[row]) for name in ("x", "y", "yaw_rad")),
            *(float(getattr(state.parked, name)[row]) for name in ("length_m", "width_m", "height_m")),
        )
        details = body.details(state.parked.kind[row], 0.0)
        details |= {"parked": True, "place": state.world.parking[place].id}
        return f"parked {place}", body, category_of_agent(is_pedestrian=False), details
    assert agent is not None
    poses = state.agents
    row = _row(poses["agent"], agent, f"agent {agent}")
    body = _Body(
        *(float(poses[column][row]) for column in ("x_m", "y_m", "yaw_rad", "length_m", "width_m", "height_m"))
    )
    speed_mps = hypot(float(poses["east_mps"][row]), float(poses["north_mps"][row]))
    category = category_of_agent(is_pedestrian=bool(poses["is_pedestrian"][row]))
    return f"agent {agent}", body, category, body.details(state.kinds[agent], speed_mps)


def _row(numbers: npt.NDArray[np.integer], number: int, what: str) -> int:
    """Row of a number."""
    there = np.flatnonzero(numbers == number)
    if not len(there):
        raise ValueError(f"the instance image shows {what}, which is not there at this time")
    return int(there[0])


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
