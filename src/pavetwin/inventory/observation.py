"""One detection of a defect in one image, on the ground."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from shapely import Polygon

from pavetwin.arrays import UInt8Array
from pavetwin.detections import NOT_RESOLVABLE, SIZES
from pavetwin.labels.boxes import FloatBox

Crop = Callable[[], UInt8Array | None]
"""Reads the picture around a detection; None where the image is gone."""


@dataclass(frozen=True)
class Observation:
    """One detection of one defect, in a metric frame: east and north of an origin."""

    kind: str
    """Class of the defect, as label files write it, such as `Pothole`."""
    confidence: float
    image: str
    """Of which image: observations of one image that lie apart are different defects."""
    box_px: FloatBox | None
    """In the image; None where it is not known."""
    footprint: Polygon | None
    """Outline on the ground; None where the image does not say where it was taken."""
    sizes: Mapping[str, float] = field(default_factory=dict)
    """By names of `SIZES`; none that the image does not show."""
    severity: str = ""
    """`low`, `medium`, `high` or a range such as `low to medium`; empty where the image does not show it."""
    pixel_m: float | None = None
    """Side of a pixel on the ground."""
    position_error_m: float = 0.0
    """Standard deviation of its place, east and north each."""
    is_cut: bool = False
    """Whether it ends at the image's border: its sizes are the least that they can be."""
    crop: Crop | None = field(default=None, repr=False, compare=False)


def shared(first: Observation, second: Observation) -> float:
    """The area of the ground that two have in common, as a share of the smaller one; 0 where a place is not known."""
    if first.footprint is None or second.footprint is None:
        return 0.0
    smaller = min(first.footprint.area, second.footprint.area)
    return float(first.footprint.intersection(second.footprint).area / smaller) if smaller else 0.0


def numbers_in(sizes: Mapping[str, float | str]) -> dict[str, float]:
    """What was measured, of all that is said of sizes: without what the image does not show."""
    return {name: size for name in SIZES if isinstance(size := sizes.get(name), float)}


def severity_in(sizes: Mapping[str, float | str]) -> str:
    """The visible severity, of all that is said of sizes."""
    severity = str(sizes.get("severity", ""))
    return "" if severity == NOT_RESOLVABLE else severity
