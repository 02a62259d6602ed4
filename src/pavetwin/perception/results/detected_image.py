"""What is written of one image: its detections with sizes, outlines and places."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.outlines import outline
from pavetwin.perception.inference.detections import Detections
from pavetwin.perception.results.measuring import Measure, measured
from pavetwin.perception.results.photograph import LonLat, PhotographPose
from pavetwin.perception.results.visible_severity import visible_severity


@dataclass(frozen=True, slots=True)
class DetectedThing:
    """One detection."""

    name: str
    """Of the class."""
    number: int
    """In `CLASSES`."""
    box: FloatBox
    """In pixels of the image."""
    detection: float
    """Confidence in the coarse class."""
    subtype: float
    """Confidence in the subtype of a defect; 1 for others."""
    area_px: float
    """Of the mask, or else of the box."""
    outline: Sequence[tuple[float, float]] | None
    """Of the mask: column and row of its corners."""
    sizes: Mapping[str, Measure | str] = field(default_factory=dict)
    """By name with unit, and the visible severity; empty where the ground resolution is not known or there is no
    mask."""
    ground: Sequence[LonLat] | None = None
    """Corners of the box on the ground, from the upper left one clockwise in the picture."""

    @property
    def confidence(self) -> float:
        """The final one."""
        return self.detection * self.subtype

    @property
    def attributes(self) -> dict[str, Any]:
        """Both confidences and the sizes, for files."""
        return {"det_conf": round(self.detection, 4), "cls_conf": round(self.subtype, 4), **self.sizes}


@dataclass(frozen=True, slots=True)
class DetectedImage:
    """An image with its detections, the most confident first."""

    name: str
    """Its file's path below the folder that was asked for; of a video, with the frame's number."""
    size_px: tuple[int, int]
    things: tuple[DetectedThing, ...]
    lonlat: LonLat | None = None
    """Of the camera."""
    gsd_mm: float | None = None
    """In the middle of the image."""


def described(
    name: str, found: Detections, pose: PhotographPose | None = None, gsd_mm: float | None = None
) -> DetectedImage:
    """Detections with what the photograph's pose adds.

    Args:
        name: of the image.
        gsd_mm: ground resolution of the whole image, which counts for more than the pose.
    """
    pose = pose or PhotographPose(found.size_px)
    things = tuple(_thing(found, at, pose, gsd_mm) for at in range(len(found)))
    middle = gsd_mm or pose.gsd_mm(found.size_px[0] / 2, found.size_px[1] / 2)
    return DetectedImage(name, found.size_px, things, pose.lonlat, round(middle, 3) if middle else None)


def sizes_of(found: Detections, at: int, gsd_mm: float) -> Mapping[str, Measure | str]:
    """Sizes of one detection by name with unit, and its visible severity; empty where it has no mask.

    Args:
        gsd_mm: of a pixel.
    """
    mask = found.mask(at)
    if mask is None or not mask[1].any():
        return {}
    cell_px = max(max(part.cell_px) for part in found.masks[at])
    name, covered = found.names[at], mask[1]
    return {**measured(name, covered, gsd_mm), "severity": visible_severity(name, covered, gsd_mm, cell_px)}


def _thing(found: Detections, at: int, pose: PhotographPose, gsd_mm: float | None) -> DetectedThing:
    left, top, right, bottom = found.box(at)
    corners, area_px = None, (right - left) * (bottom - top)
    sizes: Mapping[str, Measure | str] = {}
    mask = found.mask(at)
    if mask is not None and mask[1].any():
        (x, y, _, _), covered = mask
        corners = [(round(float(px) + x, 1), round(float(py) + y, 1)) for px, py in outline(covered)]
        area_px = float(np.count_nonzero(covered))
        if scale := gsd_mm or pose.gsd_mm((left + right) / 2, (top + bottom) / 2):
            sizes = sizes_of(found, at, scale)
    return DetectedThing(
        name=found.names[at],
        number=int(found.classes[at]),
        box=(round(left, 2), round(top, 2), round(right, 2), round(bottom, 2)),
        detection=float(found.detection[at]),
        subtype=float(found.subtype[at]),
        area_px=area_px,
        outline=corners,
        sizes=sizes,
        ground=pose.lonlats(np.array([[left, top], [right, top], [right, bottom], [left, bottom]])),
    )
