"""Images of flat spots on a dark road, and a detector that finds them exactly: the answers of a sensor are known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import UInt8Array
from pavetwin.detections import Detections, MaskPart
from pavetwin.labels.class_names import CLASSES, SUBTYPES
from pavetwin.labels.outlines import filled
from pavetwin.mission.fly import fly_over
from pavetwin.mission.result import MissionResult
from pavetwin.policies import Policy
from pavetwin.sensing import Frame
from pavetwin.sensing.detector import DetectorSensor
from scenes.tiny import Scene

Spot = tuple[str, BaseGeometry]
"""Name of its class in `CLASSES`, and its shape on the ground."""


@dataclass
class Painter:
    """An image source: every spot in the grey of its class, on black."""

    spots: Sequence[Spot]
    asked: list[Frame] = field(default_factory=list)

    def __call__(self, frame: Frame) -> UInt8Array:
        self.asked.append(frame)
        width, height = frame.camera.image_px
        image = np.zeros((height, width, 3), dtype=np.uint8)
        for name, shape in self.spots:
            assert isinstance(shape, Polygon)
            ground = np.array(shape.exterior.coords[:-1])
            pixels = frame.view.project(np.column_stack([ground[:, :2], np.zeros(len(ground))]))
            grey = 40 * (CLASSES.index(name) + 1)
            image[filled(pixels, (width, height))] = grey
        return image


@dataclass
class SpotDetector:
    """Reports the box and class of every spot, with a stated confidence."""

    image_px: int = 640
    tiled: bool = False
    confidence: float = 0.9
    masks: bool = True

    @property
    def gives_masks(self) -> bool:
        return self.masks

    def detect(self, images: Iterable[UInt8Array]) -> list[Detections]:
        return [self._found(image) for image in images]

    def _found(self, image: UInt8Array) -> Detections:
        boxes, names, masks = [], [], []
        for number, name in enumerate(CLASSES):
            covered = (image[..., 0] == 40 * (number + 1)).astype(np.uint8)
            count, parts, stats, _ = cv2.connectedComponentsWithStats(covered)
            for part in range(1, count):
                left, top, across, down, _ = (int(side) for side in stats[part])
                box = (float(left), float(top), float(left + across), float(top + down))
                boxes.append(box)
                names.append(name)
                grid = (parts[top : top + down, left : left + across] == part).astype(np.float32)
                masks.append((MaskPart(box, grid),) if self.masks and name in SUBTYPES else ())
        confidence = np.full(len(boxes), self.confidence, dtype=np.float32)
        return Detections(
            names,
            confidence,
            size_px=(image.shape[1], image.shape[0]),
            box_px=np.array(boxes, dtype=np.float32),
            mask=masks,
            detection_confidence=confidence,
            subtype_confidence=np.ones(len(boxes), dtype=np.float32),
        )


def fly_over_spots(
    scene: Scene, spots: Sequence[Spot], *, aboard: bool, policy: str | Policy = "hover", confidence: float = 0.9
) -> tuple[MissionResult, Painter]:
    """Fly over the first segment with the sensor `detector` and a stand-in that finds the spots."""
    settings = scene.settings("sensing.sensor=detector", f"sensing.options={{aboard: {str(aboard).lower()}}}")
    painter = Painter(spots)
    eyes = DetectorSensor(settings.sensing, 0, SpotDetector(image_px=240, confidence=confidence))
    environment = scene.environment(settings)
    result = fly_over(environment, scene.traffic(), settings, [0], policy, sensor=eyes, image_source=painter)
    return result, painter
