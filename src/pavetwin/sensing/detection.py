"""What a sensor reports, and the outcome of each report once it is compared with the defects that are there."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from shapely import Polygon

from pavetwin.errors import nearest_name
from pavetwin.sensing.frame import Box, Frame, Sighting
from pavetwin.twin import Place

OTHER_CLASSES: Final = frozenset({"person", "car", "Person", "Car"})
"""What every sensor may report that is not a defect, also spelled as in label files."""


def unknown_class(kind: str, defects: Collection[str], others: Collection[str]) -> str:
    """What is wrong with a detection's class, in words; empty where it is known.

    Args:
        defects: the classes of defects.
        others: what the sensor says it reports beside them, see `Sensor.other_classes`.
    """
    if kind in defects or kind in OTHER_CLASSES or kind in others:
        return ""
    near = nearest_name(kind.lower().replace(" ", "_"), defects)
    return (
        f"the class '{kind}', which is not a class of defects{near}; known are {', '.join(sorted(defects))}. A class "
        "that is not a defect belongs in its `other_classes`"
    )


@dataclass(frozen=True)
class MeasuredSizes:
    """What was measured of an object in one image."""

    sizes: Mapping[str, float | str]
    """By name with unit (`pavetwin.perception.results.measuring`), and the visible severity; empty where no mask is
    known. A text says that the image does not show it."""
    pixel_mm: float
    """Side of a pixel on the ground, in the image that was looked at."""
    is_cut: bool
    """Whether it ends at the image's border, and may go on beyond."""


@dataclass(frozen=True, slots=True)
class Detection:
    """One object that a sensor reports in a frame.

    At least one of its two places is given; the other follows from the frame's camera and pose.

    Raises:
        ValueError: neither place is given, or the confidence is not a share.
    """

    kind: str
    """Its class: a defect class such as `pothole`, one of `OTHER_CLASSES`, or one of the sensor's `other_classes`."""
    confidence: float
    """0 … 1."""
    footprint: Polygon | None = None
    """On the ground, world frame, metres."""
    box_px: Box | None = None
    """In the image."""
    measures: MeasuredSizes | None = None
    """None for sensors that measure nothing."""
    means_nothing: bool = False
    """A false alarm by intent, of a sensor without images: it is matched with no defect."""

    def __post_init__(self) -> None:
        if self.footprint is None and self.box_px is None:
            raise ValueError("a detection needs a footprint on the ground or a box in the image")
        if not 0.0 <= self.confidence <= 1.0:
            raise ValueError(f"a confidence lies between 0 and 1, not at {self.confidence}")

    @classmethod
    def of(cls, sighting: Sighting, confidence: float = 1.0) -> "Detection":
        """What a sensor reports that outlines a defect exactly."""
        return cls(sighting.defect.kind, confidence, footprint=sighting.defect.polygon)

    def ground(self, frame: Frame) -> Polygon:
        """Its footprint, world frame."""
        if self.footprint is not None:
            return self.footprint
        assert self.box_px is not None
        return frame.footprint_of(self.box_px)

    def box(self, frame: Frame) -> Box:
        """Its box in the image, pixels."""
        return self.box_px if self.box_px is not None else frame.box_of(self.ground(frame))


class Outcome(StrEnum):
    """The judgement of a detection."""

    CONFIRMED = "confirmed"
    """The first detection of a defect that the capture sees."""
    DUPLICATE = "duplicate"
    """A further detection of a defect that is confirmed already."""
    FALSE_ALARM = "false_alarm"
    """Nothing of its class is there."""
    IGNORED = "ignored"
    """Neither right nor wrong: a defect that the capture does not see (outside the window, or too much of it is
    hidden), or an object that is not a defect."""


class JudgedDetection(NamedTuple):
    """A detection of a mission, the capture it is from, and its outcome."""

    outcome: Outcome
    detection: Detection
    frame: Frame
    """Of the capture; its `source` is left out."""
    defect: int | None
    """The defect it matches; None for a false alarm and for what is not a defect."""
    sighting: Sighting | None
    """Of that defect; None where the capture does not see it."""
    segment: int
    """Index of the segment under inspection."""
    on_revisit: bool

    @property
    def kind(self) -> str:
        return self.detection.kind

    @property
    def confidence(self) -> float:
        return self.detection.confidence

    @property
    def measures(self) -> MeasuredSizes | None:
        """See `Detection`."""
        return self.detection.measures

    @property
    def footprint(self) -> Polygon | None:
        """On the ground; None where the defect's own outline is meant."""
        outline = self.detection.footprint
        if outline is not None and any(each.defect.polygon is outline for each in self.frame.sightings):
            return None
        return self.detection.ground(self.frame)

    @property
    def capture(self) -> int:
        """Index of the capture."""
        return self.frame.number

    @property
    def time_s(self) -> float:
        return self.frame.time_s

    @property
    def position(self) -> Place:
        """Of the camera."""
        return self.frame.position

    @property
    def yaw_rad(self) -> float:
        return self.frame.yaw_rad

    @property
    def velocity_mps(self) -> Place:
        return self.frame.velocity_mps

    @property
    def attempt(self) -> int | None:
        """1 for the first capture in which the defect could be found; None where the capture does not see it."""
        return None if self.sighting is None else self.sighting.attempt + 1

    @property
    def visible_fraction(self) -> float | None:
        """Of the defect's area; None where the capture does not see it."""
        return None if self.sighting is None else self.sighting.visible_fraction
