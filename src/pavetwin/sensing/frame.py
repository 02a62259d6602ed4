"""Captures as sensors see them, and looks at defects in them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import cos, hypot, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import UInt8Array
from pavetwin.config.conditions import Conditions
from pavetwin.defects.measures import Orientation
from pavetwin.errors import PaveTwinError
from pavetwin.scene.view import View, nadir
from pavetwin.twin import Place
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import Defect

Box = tuple[float, float, float, float]
"""Left, top, right, bottom in pixels; (0, 0) is the image's upper left corner."""

ImageSource = Callable[["Frame"], UInt8Array]
"""Renders the image of a frame: (height, width, 3) sRGB. The caller of the mission passes it in."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A defect that a frame can show: its centre is in the inspection window and enough of its area is visible."""

    defect: Defect
    visible_fraction: float
    """Share of its area that no agent and no static object hides, 0 … 1."""
    attempt: int
    """0 for the first capture in which a sensor may find it."""
    across_m: float
    """Smallest extent of the whole defect: the width of a crack, else the shorter side (`smallest_extent_m`)."""
    orientations: Sequence[Orientation] = ()
    """Directions of a thin defect, each with its share of the length (`orientations_of`): only motion blur across the
    direction widens it. Empty for any other defect, for which all of the blur counts."""


@dataclass(frozen=True)
class Frame:
    """One capture of a camera that looks straight down."""

    number: int
    """Index of the capture in the mission, from 0."""
    time_s: float
    """Since the beginning of the mission."""
    position: Place
    """Position of the camera in the world frame, metres."""
    altitude_m: float
    yaw_rad: float
    """Direction of the image's upper edge, anticlockwise from east."""
    camera: Camera
    """Its intrinsics."""
    conditions: Conditions
    """Date, time of the mission's beginning, clouds and wind."""
    velocity_mps: Place = (0.0, 0.0)
    """Velocity of the ground in view (east, north), which blurs the image: that of the UAV and of gusts."""
    exposure_s: float = 0.001
    """Shutter time."""
    sun_elevation_deg: float | None = None
    """Elevation of the sun when the mission begins, fixed during the mission; None if it is not known."""
    sightings: Sequence[Sighting] = ()
    source: ImageSource | None = field(default=None, repr=False, compare=False)

    def image(self) -> UInt8Array:
        """(height, width, 3) sRGB of the size of the camera's `image_px`; rendered on each call.

        Raises:
            PaveTwinError: the mission has no image source.
        """
        if self.source is None:
            raise PaveTwinError(
                "This mission has no images: its sensor requests one, but no renderer was passed "
                "(parameter image_source)."
            )
        return self.source(self)

    @cached_property
    def ground_resolution_m(self) -> float:
        """Side of a pixel on the ground, in metres; the same everywhere on a level road."""
        return self.camera.ground_resolution_m(self.altitude_m)

    @property
    def blur_m(self) -> Place:
        """Motion blur: displacement of the ground during the exposure (east, north), metres."""
        return self.velocity_mps[0] * self.exposure_s, self.velocity_mps[1] * self.exposure_s

    @property
    def blur_px(self) -> float:
        """Length of the motion blur, in pixels."""
        return hypot(*self.velocity_mps) * self.exposure_s / self.ground_resolution_m

    @property
    def blurred_pixel_m(self) -> float:
        """Length of a blurred pixel on the ground in the direction of motion: √(1 + blur_px²) pixels, in metres.

        A pixel one wide, smeared over b pixels, has the variance (1 + b²) / 12 of a pixel of that width.
        """
        return self.ground_resolution_m * hypot(1.0, self.blur_px)

    def pixel_across_m(self, east: float, north: float) -> float:
        """Length of a blurred pixel across a line in this direction: √(g² + (b sin φ)²), in metres, with the
        ground resolution g, the motion blur b and the angle φ between them.

        Args:
            east: of a unit vector along the line.
            north: of that vector.
        """
        blur = self.blur_m
        return hypot(self.ground_resolution_m, blur[0] * north - blur[1] * east)

    @cached_property
    def view(self) -> View:
        """The pinhole camera at its pose."""
        return nadir(
            self.camera,
            (*self.position, self.altitude_m),
            yaw_rad=self.yaw_rad,
            velocity_mps=(*self.velocity_mps, 0.0),
        )

    @cached_property
    def footprint(self) -> Polygon:
        """The ground that the image shows, world frame."""
        width, height = self.camera.image_px
        return self.footprint_of((0.0, 0.0, float(width), float(height)))

    def box_of(self, shape: BaseGeometry) -> Box:
        """The box around a shape on the ground (world frame) in pixels of `image()`, cut at the image's border."""
        ground = shapely.get_coordinates(shape)
        pixels = self.view.project(np.column_stack([ground, np.zeros(len(ground))]))
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        low, high = (np.clip(corner, 0.0, self.camera.image_px) for corner in (low, high))
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def footprint_of(self, box: Box) -> Polygon:
        """The ground under a box in pixels of `image()`, world frame."""
        left, top, right, bottom = box
        return Polygon(self.view.ground([(left, top), (right, top), (right, bottom), (left, bottom)]))


class Look(NamedTuple):
    """View of a defect in one image, known without it. Pixels are those of the image that a detector searches."""

    kind: str
    severity: str
    width_px: float
    """Widest opening of a crack, also of one in a network; mean diameter of a pothole."""
    size_px: float
    """Root of its whole area."""
    pixel_mm: float
    """Side of a pixel on the ground."""
    visible_fraction: float
    """Share of its area that nothing hides, 0 … 1."""
    inside_fraction: float
    """Share of its area within the image, 0 … 1."""
    off_centre: float
    """Distance of its centre from the image's centre, as a share of a corner's distance, 0 … 1."""
    blur_px: float
    """Length of the motion blur."""
    sun_elevation_deg: float | None
    """None if unknown."""
    clouds: float
    """Cloud cover, 0 … 1."""


def seen_camera(camera: Camera, longest_px: int) -> Camera:
    """A camera with the pixels of the images that a detector searches, and the same field of view.

    Args:
        longest_px: longer side of the images, unless the camera's own is shorter.
    """
    scale = min(1.0, longest_px / max(camera.image_px))
    width, height = (max(1, round(scale * side)) for side in camera.image_px)
    return camera.model_copy(update={"image_px": (width, height)})


class OutlineShape(NamedTuple):
    """Centre, size and reach of an outline in the world frame."""

    x: float
    y: float
    size_m: float
    """Root of the area."""
    reach_m: float
    """Distance from the centre to the farthest point."""


class LookMeter:
    """Measures looks at defects."""

    def __init__(self, longest_px: int | None = None) -> None:
        """Args:
        longest_px: longer side of the searched images; by default the camera's.
        """
        self._longest_px = longest_px

    def pixel_m(self, frame: Frame) -> float:
        """Side of a pixel on the ground, in the image that is searched."""
        longer = max(frame.camera.image_px)
        return frame.ground_resolution_m * max(1.0, longer / (self._longest_px or longer))

    def look(self, frame: Frame, sighting: Sighting) -> Look:
        """The look of a capture at a defect."""
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
"""Shapes by the identity of the outline, which missions over one environment share; hashing outlines is slower."""
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
