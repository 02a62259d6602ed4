"""The sensor that searches images: each capture is rendered, and a trained detector finds defects in the image."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType
from typing import Any, ClassVar, Final, Protocol

import numpy as np
from shapely import Polygon

from pavetwin.arrays import UInt8Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.detections import SIZES, Detections
from pavetwin.labels.boxes import ends_at_border
from pavetwin.perception.model_file import DEFAULT
from pavetwin.sensing.frame import Frame, seen_camera
from pavetwin.sensing.sensor import Sensor, sensor
from pavetwin.uav.cameras import Camera

LARGEST_PX: Final = 2048
"""Longer side of the images for a model that searches large ones in tiles, unless set."""

_WAITING: Final = 4
"""Most images that wait for the detector; bounds the memory."""


class ImageDetector(Protocol):
    """The interface of `pavetwin.perception.detector.Detector` that the sensor uses."""

    @property
    def image_px(self) -> int:
        """Longer side of the network's input."""
        ...

    @property
    def tiled(self) -> bool:
        """Whether it searches larger images in tiles."""
        ...

    @property
    def gives_masks(self) -> bool:
        """Whether its detections of defects have masks."""
        ...

    def detect(self, images: Iterable[UInt8Array]) -> list[Detections]:
        """The detections of each image (height, width, 3)."""
        ...


def default_image_px(detector: ImageDetector) -> int:
    """Longer side of the images that a detector searches in missions, unless set or limited by the camera."""
    return LARGEST_PX if detector.tiled else detector.image_px


@sensor("detector")
class DetectorSensor(Sensor):
    """Reports the detections of a model file of `pavetwin export` in the rendered image of each capture.

    The image has the camera's field of view and the pixels that the model takes. A detection's footprint is the convex
    hull of its mask, or else its box, on the ground as a level plane; its sizes come from the mask.

    It keeps its detections: missions that share a world, traffic, light and seed also share captures until their
    policies part, and each of these is rendered and searched once.

    Unless `aboard`, captures are rendered and searched after landing: policies do not know the detections. For a policy
    that does not use them, the detections are the same both ways.
    """

    every_capture = True
    sees_confirmed = True
    is_reused = True
    measures_sizes = True
    default_options: ClassVar[Mapping[str, OptionValue]] = MappingProxyType(
        {"model": DEFAULT, "confidence": 0.25, "image_px": 0, "aboard": False}
    )
    model_options = ("model",)

    def __init__(self, settings: SensingSettings, seed: int, detector: ImageDetector | None = None) -> None:
        """Args:
            detector: in place of the model in the option `model`.

        Raises:
            PaveTwinError: there is no such model, or its file is damaged, or an option does not fit.
        """
        super().__init__(settings, seed)
        self.after_landing = not self.options["aboard"]
        self._detector = detector or self._opened()
        self.measures_sizes = self._detector.gives_masks
        self._found: dict[int, list[tuple[Frame, Detections]]] = {}
        """Frames without sightings and their detections, keyed by the capture's number."""

    def _opened(self) -> ImageDetector:
        from pavetwin.perception.detector import Detector

        return Detector(str(self.options["model"]), confidence=float(self.options["confidence"]))

    @property
    def looked_px(self) -> int:
        return int(self.options["image_px"]) or default_image_px(self._detector)

    def seen_camera(self, camera: Camera) -> Camera:
        """A camera with the pixels of the images that the detector searches, and the same field of view."""
        return seen_camera(camera, self.looked_px)

    def look_at(self, frames: Sequence[Frame], on_progress: Callable[[float], None] = lambda _: None) -> None:
        """Render captures and search their images; `detect` then returns the stored detections.

        While one image is searched, the next one is rendered.
        """
        waiting: deque[tuple[Frame, Future[Detections]]] = deque()
        left = [frame for frame in frames if self._known(frame) is None]
        taken: list[Frame] = []

        def take() -> None:
            frame, found = waiting.popleft()
            self._remember(frame, found.result())
            taken.append(frame)
            on_progress(1.0 - (len(left) - len(taken)) / len(frames))

        with ThreadPoolExecutor(1) as pool:
            for frame in left:
                seen = self._seen(frame)
                waiting.append((frame, pool.submit(self._searched, frame, seen, seen.image())))
                if len(waiting) > _WAITING:
                    take()
            while waiting:
                take()
        on_progress(1.0)

    def detect(self, frame: Frame) -> Detections:
        known = self._known(frame)
        if known is not None:
            return known
        seen = self._seen(frame)
        found = self._searched(frame, seen, seen.image())
        self._remember(frame, found)
        return found

    def _known(self, frame: Frame) -> Detections | None:
        """The stored detections of a capture; None for one that is not searched yet."""
        asked = replace(frame, sightings=())
        return next((found for known, found in self._found.get(frame.number, ()) if known == asked), None)

    def _remember(self, frame: Frame, found: Detections) -> None:
        self._found.setdefault(frame.number, []).append((replace(frame, sightings=(), source=None), found))

    def _seen(self, frame: Frame) -> Frame:
        return replace(frame, camera=self.seen_camera(frame.camera))

    def _searched(self, frame: Frame, seen: Frame, image: UInt8Array) -> Detections:
        """Args:
        seen: the frame with the camera of the image.
        """
        (found,) = self._detector.detect([image])
        return _on_ground(found, frame, seen)


def _on_ground(found: Detections, frame: Frame, seen: Frame) -> Detections:
    """Detections in an image with sizes and with places on the ground, in pixels of the frame's own camera.

    Args:
        seen: the frame with the camera of the image.
    """
    from pavetwin.perception.measuring import with_sizes  # OpenCV, which other sensors do not need

    measured = with_sizes(found, 1000.0 * seen.ground_resolution_m)
    sizes: dict[str, Any] = {name: measured.columns[name] for name in ("pixel_mm", "severity", *SIZES)}
    boxes = [found.box(row) for row in range(len(found))]
    grounds = [seen.footprint_of(box) for box in boxes]
    return Detections(
        found.class_name,
        np.minimum(1.0, found.confidence),
        footprint=[_hull(found, row, seen) or ground for row, ground in enumerate(grounds)],
        box_px=[frame.box_of(ground) for ground in grounds],
        is_cut=[ends_at_border(box, seen.camera.image_px) for box in boxes],
        **sizes,
    )


def _hull(found: Detections, row: int, seen: Frame) -> Polygon | None:
    """The convex hull of a mask on the ground; None for one that covers nothing."""
    from pavetwin.labels.outlines import hull

    mask = found.mask_pixels(row)
    return Polygon(seen.view.ground(hull(mask[1]) + mask[0][:2])) if mask is not None and mask[1].any() else None
