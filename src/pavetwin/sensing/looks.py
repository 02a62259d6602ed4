"""What one look shows of a defect, as far as it is known without an image: what a fitted sensor predicts from."""

from math import cos, hypot, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.sensing.frame import Frame, Sighting
from pavetwin.uav.cameras import Camera


class Look(NamedTuple):
    """A defect in an image. Pixels are those of the image that a detector looks at, not of the camera."""

    kind: str
    severity: str
    width_px: float
    """Widest opening of a crack, also of one in a network; mean diameter of a pothole."""
    size_px: float
    """Root of its whole area."""
    pixel_mm: float
    """Side of a pixel on the ground."""
    visible_fraction: float
    """Of its area, that nothing hides, 0 … 1."""
    inside_fraction: float
    """Of its area, that lies within the image, 0 … 1."""
    off_centre: float
    """Of its centre: the way to the image's centre as a share of that to a corner, 0 … 1."""
    blur_px: float
    """Length of the motion blur."""
    sun_elevation_deg: float | None
    """None where it is not known."""
    clouds: float
    """Cloud cover, 0 … 1."""


def seen_camera(camera: Camera, longest_px: int) -> Camera:
    """A camera with the pixels of the images that a detector looks at; the field of view stays.

    Args:
        longest_px: longer side of the images, unless the camera's own is shorter.
    """
    scale = min(1.0, longest_px / max(camera.image_px))
    width, height = (max(1, round(scale * side)) for side in camera.image_px)
    return camera.model_copy(update={"image_px": (width, height)})


class OutlineShape(NamedTuple):
    """What counts of an outline, world frame."""

    x: float
    y: float
    size_m: float
    """Root of the area."""
    reach_m: float
    """From the centre to the farthest point."""


class LookMeter:
    """Says what captures show of defects."""

    def __init__(self, longest_px: int | None = None) -> None:
        """Args:
        longest_px: longer side of the images that are looked at; the camera's own unless given.
        """
        self._longest_px = longest_px

    def pixel_m(self, frame: Frame) -> float:
        """Side of a pixel on the ground, in the image that is looked at."""
        longer = max(frame.camera.image_px)
        return frame.ground_resolution_m * max(1.0, longer / (self._longest_px or longer))

    def look(self, frame: Frame, sighting: Sighting) -> Look:
        """What a capture shows of a defect."""
        defect, own_m = sighting.defect, frame.ground_resolution_m
        pixel_m = self.pixel_m(frame)
        shape = shape_of(defect.polygon)
        east, north = frame.position
        away_m = hypot(shape.x - east, shape.y - north)
        is_whole = away_m + shape.reach_m <= own_m * min(frame.camera.image_px) / 2
        return Look(
            kind=defect.kind,
            severity=str(defect.severity),
            width_px=defect.width_m / pixel_m,
            size_px=shape.size_m / pixel_m,
            pixel_mm=1000.0 * pixel_m,
            visible_fraction=sighting.visible_fraction,
            inside_fraction=1.0 if is_whole else inside_share(frame, defect.polygon),
            off_centre=min(1.0, away_m / (own_m * hypot(*frame.camera.image_px) / 2)),
            blur_px=frame.blur_px * own_m / pixel_m,
            sun_elevation_deg=frame.sun_elevation_deg,
            clouds=frame.conditions.clouds,
        )


_SHAPES: Final[dict[int, tuple[Polygon, OutlineShape]]] = {}
"""By the outline's identity, which missions over one environment share; hashing an outline takes longer."""
_MOST_SHAPES: Final = 16384


def shape_of(polygon: Polygon) -> OutlineShape:
    """The shape of an outline, measured once."""
    known = _SHAPES.get(id(polygon))
    if known is None or known[0] is not polygon:
        if len(_SHAPES) >= _MOST_SHAPES:
            _SHAPES.clear()
        known = _SHAPES[id(polygon)] = polygon, _measured(polygon)
    return known[1]


def _measured(polygon: Polygon) -> OutlineShape:
    centre = polygon.centroid
    reach_m = np.hypot(*(shapely.get_coordinates(polygon) - (centre.x, centre.y)).T).max()
    return OutlineShape(centre.x, centre.y, sqrt(polygon.area), float(reach_m))


def inside_share(frame: Frame, polygon: Polygon) -> float:
    """The share of an outline's area that lies within the image, 0 … 1."""
    cosine, sine = cos(frame.yaw_rad), sin(frame.yaw_rad)
    turn = np.array([[sine, cosine], [-cosine, sine]])
    turned = shapely.transform(polygon, lambda places: (places - frame.position) @ turn)
    right, ahead = (frame.ground_resolution_m * side / 2 for side in frame.camera.image_px)
    # Clipping in the axes of the image takes a fifth of the time of an intersection, and finds the same area.
    return min(1.0, float(shapely.clip_by_rect(turned, -right, -ahead, right, ahead).area / polygon.area))
