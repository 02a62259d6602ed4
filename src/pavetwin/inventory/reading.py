"""Detections of a source, a mission or a folder of photographs, before they are merged into entries."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import UInt8Array
from pavetwin.detections import SIZES, Detections
from pavetwin.draw.contact_sheet import cut_around, draw_box
from pavetwin.errors import PaveTwinError
from pavetwin.inventory.entry import Entry, entry_of, with_probabilities
from pavetwin.inventory.merging import merged
from pavetwin.labels.boxes import FloatBox
from pavetwin.perception.photograph import PhotographPose
from pavetwin.sensing.fitted_sensor import EntryModel
from pavetwin.world.georeference import GeoReference

_CROP_MARGIN: Final = 1.6
"""Side of a crop over the longer side of the box."""

_LEAST_CROP_PX: Final = 96

ReadImage = Callable[[], tuple[UInt8Array, PhotographPose | None]]
"""Reads the pixels of an image and its pose."""


@dataclass(frozen=True)
class Reading:
    """Detections of defects in one metric frame."""

    detections: Detections
    """With `image`, and with footprints in `frame` where the place is known."""
    frame: GeoReference | None
    """Frame of the footprints; None where no image states its place."""
    images: int
    """Number of images that were searched."""
    remarks: tuple[str, ...] = ()
    """Missing inputs, a sentence each."""
    detector: str | None = None
    """SHA-256 of the model file that searched the images; None where it is not known."""
    entry_model: EntryModel | None = None
    """Model of the probability that an entry shows a defect; None where no sensor was fitted to the detector."""
    is_of_measuring: bool = False
    """Whether its sensor measures sizes (`pavetwin.sensing.Sensor.measures_sizes`); used where there are no
    detections."""
    readers: Mapping[str, ReadImage] = field(default_factory=dict, repr=False, compare=False)
    """Readers of the images that are available, by name."""

    @property
    def is_measured(self) -> bool:
        """Whether sizes of detections are measured; also true without detections."""
        return has_sizes(self.detections) if len(self.detections) else self.is_of_measuring

    def confident(self, least: float) -> Detections:
        """The detections of at least this confidence.

        Raises:
            PaveTwinError: it is not from 0 to 1.
        """
        if not 0 <= least <= 1:
            raise PaveTwinError(f"`confidence` {least:g}: it is from 0 to 1.")
        return self.detections[self.detections.confidence >= least]

    def crop(self, detection: Detections) -> UInt8Array | None:
        """The part of an image around a detection, a record of one row; None where the image or its pose is missing.

        Raises:
            PaveTwinError: the image can no longer be read.
        """
        read = self.readers.get(detection.image[0])
        if read is None:
            return None
        pixels, pose = read()
        if not np.isnan(detection.box_px[0, 0]):
            return _around(pixels, detection.box(0))
        if pose is None or self.frame is None:
            return None
        corners = pose.pixels(self.frame.to_wgs84(shapely.get_coordinates(detection.footprint[0])))
        if corners is None:
            return None
        (left, top), (right, bottom) = np.min(corners, axis=0).tolist(), np.max(corners, axis=0).tolist()
        return _around(pixels, (left, top, right, bottom))


def _around(pixels: UInt8Array, box: FloatBox) -> UInt8Array:
    """(side, side, 3) The square part of an image (height, width, 3) around a box, which is drawn in it; black beyond
    the image."""
    part, edges = cut_around(Image.fromarray(pixels), box, margin=_CROP_MARGIN, least_px=_LEAST_CROP_PX)
    draw_box(ImageDraw.Draw(part), edges, "#FFFFFF")
    return np.asarray(part)


def has_sizes(detections: Detections) -> bool:
    """Whether any size of a detection is measured."""
    return any(bool(np.isfinite(getattr(detections, name)).any()) for name in SIZES)


def counted_remarks(found: Mapping[str, list[str]], wholes: int) -> tuple[str, ...]:
    """A sentence for each reason, with the number of its images and the first of them.

    Args:
        found: names of images by reason, which continues "3 of 9 photographs, such as 'a.jpg': ".
        wholes: number of all images.
    """
    return tuple(
        f"{len(names)} of {wholes} photographs, such as '{names[0]}': {reason}." for reason, names in found.items()
    )


CONFIDENCE: Final = 0.25
"""Default least confidence of a detection."""


def entries_of(reading: Reading, confidence: float = CONFIDENCE) -> list[Entry]:
    """One entry for each defect that a reading shows with at least this confidence.

    Raises:
        PaveTwinError: the confidence is not from 0 to 1.
    """
    kept = reading.confident(confidence)
    entries = [entry_of(number, kept[group]) for number, group in enumerate(merged(kept), 1)]
    return entries if reading.entry_model is None else with_probabilities(entries, reading.entry_model)
