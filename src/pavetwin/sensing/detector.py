"""The sensor that looks: each capture is rendered, and a trained detector says what it sees in the image."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Final, Protocol

from shapely import Polygon

from pavetwin.arrays import BoolArray, UInt8Array
from pavetwin.config.mission import SensingSettings
from pavetwin.config.options import OptionValue
from pavetwin.labels.boxes import PixelBox, ends_at_border
from pavetwin.perception.shipped import DEFAULT
from pavetwin.sensing.base import Sensor
from pavetwin.sensing.detection import Detection, MeasuredSizes
from pavetwin.sensing.frame import Frame
from pavetwin.sensing.looks import seen_camera
from pavetwin.sensing.registered import sensor
from pavetwin.uav.cameras import Camera

if TYPE_CHECKING:
    from pavetwin.perception.inference import Detections

LARGEST_PX: Final = 2048
"""Longer side of the images for a model that looks at large ones in tiles, unless set."""

_WAITING: Final = 4
"""Images that wait for the detector at most, which bounds the memory."""


class ImageDetector(Protocol):
    """What the sensor asks: `pavetwin.perception.inference.Detector`, or a stand-in with stated answers."""

    @property
    def image_px(self) -> int:
        """Longer side of what the network sees."""
        ...

    @property
    def tiled(self) -> bool:
        """Whether it looks at larger images in tiles."""
        ...

    @property
    def gives_masks(self) -> bool:
        """Whether its detections of defects have masks."""
        ...

    def detect(self, images: Iterable[UInt8Array]) -> "list[Detections]":
        """The detections of each image (height, width, 3)."""
        ...


def default_image_px(detector: ImageDetector) -> int:
    """Longer side of the images that a detector looks at in missions, unless set, or the camera's is shorter."""
    return LARGEST_PX if detector.tiled else detector.image_px


@sensor("detector")
class DetectorSensor(Sensor):
    """Reports what a model file of `pavetwin export` finds in the rendered image of each capture.

    The image has the camera's field of view and the pixels that the model takes. A detection's footprint is the convex
    hull of its mask, or else its box, on the ground as a level plane; its sizes come from the mask.

    It remembers what it found: missions that share a world, traffic, light and seed also share captures, until their
    policies part, and each of these is rendered and searched once.

    Unless `aboard`, the mission is flown first, and its captures are rendered and searched after landing: policies do
    not know what was found. What is found is the same both ways for a policy that does not ask.
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
            detector: in place of the one that the option `model` names.

        Raises:
            PaveTwinError: there is no such model, or its file is damaged, or an option does not fit.
        """
        super().__init__(settings, seed)
        self.after_landing = not self.options["aboard"]
        self._detector = detector or self._opened()
        self.measures_sizes = self._detector.gives_masks
        self._found: dict[int, list[tuple[Frame, list[Detection]]]] = {}
        """By the capture's number: what was found in frames, which are without sightings."""

    def _opened(self) -> ImageDetector:
        from pavetwin.perception.inference import Detector

        return Detector(str(self.options["model"]), confidence=float(self.options["confidence"]))

    @property
    def looked_px(self) -> int:
        return int(self.options["image_px"]) or default_image_px(self._detector)

    def seen_camera(self, camera: Camera) -> Camera:
        """A camera with the pixels of the images that the detector looks at; the field of view stays."""
        return seen_camera(camera, self.looked_px)

    def look_at(self, frames: Sequence[Frame], on_progress: Callable[[float], None] = lambda _: None) -> None:
        """Render captures and search their images; `detect` then answers from what was found.

        While one image is searched, the next one is rendered.
        """
        waiting: deque[tuple[Frame, Future[list[Detection]]]] = deque()
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

    def detect(self, frame: Frame) -> Sequence[Detection]:
        known = self._known(frame)
        if known is not None:
            return known
        seen = self._seen(frame)
        found = self._searched(frame, seen, seen.image())
        self._remember(frame, found)
        return found

    def _known(self, frame: Frame) -> list[Detection] | None:
        """What was found in this capture; None where it was not looked at."""
        asked = replace(frame, sightings=())
        return next((found for known, found in self._found.get(frame.number, ()) if known == asked), None)

    def _remember(self, frame: Frame, found: list[Detection]) -> None:
        self._found.setdefault(frame.number, []).append((replace(frame, sightings=(), source=None), found))

    def _seen(self, frame: Frame) -> Frame:
        return replace(frame, camera=self.seen_camera(frame.camera))

    def _searched(self, frame: Frame, seen: Frame, image: UInt8Array) -> list[Detection]:
        """Args:
        seen: the frame with the camera that took the image.
        """
        (found,) = self._detector.detect([image])
        return [_detection(found, at, frame, seen) for at in range(len(found))]


def _detection(found: "Detections", at: int, frame: Frame, seen: Frame) -> Detection:
    from pavetwin.perception.results.detected_image import sizes_of

    box = found.box(at)
    on_ground = seen.footprint_of(box)
    mask = found.mask(at)
    pixel_mm = 1000.0 * seen.ground_resolution_m
    return Detection(
        kind=found.names[at].lower().replace(" ", "_"),
        confidence=float(min(1.0, found.confidence[at])),
        footprint=(None if mask is None else _hull(*mask, seen)) or on_ground,
        box_px=frame.box_of(on_ground),
        measures=MeasuredSizes(
            sizes=sizes_of(found, at, pixel_mm),
            pixel_mm=pixel_mm,
            is_cut=ends_at_border(box, found.size_px),
        ),
    )


def _hull(window: PixelBox, covered: BoolArray, seen: Frame) -> Polygon | None:
    """The convex hull of a mask on the ground; None for one that covers nothing."""
    from pavetwin.labels.outlines import hull

    return Polygon(seen.view.ground(hull(covered) + window[:2])) if covered.any() else None
