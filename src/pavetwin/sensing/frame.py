"""One capture as sensors see it: camera, pose, light, motion, and its image where somebody can take it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import hypot

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
"""Takes the image of a frame: (height, width, 3) sRGB. Handed in by whoever flies, since sensors know no renderer."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A defect that a frame can show: its centre is in the inspection window and enough of its area is visible."""

    defect: Defect
    visible_fraction: float
    """Share of its area that no agent and no static object hides, 0 … 1."""
    attempt: int
    """0 for the first capture in which a sensor may find it."""
    across_m: float
    """Its size where it is smallest, whole: the width of a crack, else the shorter side (`smallest_extent_m`)."""
    orientations: Sequence[Orientation] = ()
    """Of a thin defect the directions in which it runs, each with its share of the length (`orientations_of`): only the
    part of motion blur that lies across it widens it. Empty for any other: all of the blur counts."""


@dataclass(frozen=True)
class Frame:
    """One capture of a camera that looks straight down."""

    number: int
    """Index of the capture in the mission, from 0."""
    time_s: float
    """Since the beginning of the mission."""
    position: Place
    """Of the camera, world frame, metres."""
    altitude_m: float
    yaw_rad: float
    """Direction of the image's upper edge, anticlockwise from east."""
    camera: Camera
    """Its intrinsics."""
    conditions: Conditions
    """Date, time of the mission's beginning, clouds and wind."""
    velocity_mps: Place = (0.0, 0.0)
    """How fast the camera sees the ground pass (east, north), which blurs the image: the velocity of the UAV, and what
    gusts add to it."""
    exposure_s: float = 0.001
    """Shutter time."""
    sun_elevation_deg: float | None = None
    """Of the sun above the horizon when the mission begins; None where nobody says. Light stays as it is then."""
    sightings: Sequence[Sighting] = ()
    source: ImageSource | None = field(default=None, repr=False, compare=False)

    def image(self) -> UInt8Array:
        """(height, width, 3) sRGB of the size of the camera's `image_px`; taken now, and not kept.

        Raises:
            PaveTwinError: the mission has no image source.
        """
        if self.source is None:
            raise PaveTwinError(
                "This mission has no images: its sensor asks for one, and nothing that renders was handed in "
                "(parameter image_source)."
            )
        return self.source(self)

    @cached_property
    def ground_resolution_m(self) -> float:
        """What a pixel covers on the ground, in metres; the same for every defect on a level road."""
        return self.camera.ground_resolution_m(self.altitude_m)

    @property
    def blur_m(self) -> Place:
        """Motion blur: how far the ground passes during the exposure (east, north), metres."""
        return self.velocity_mps[0] * self.exposure_s, self.velocity_mps[1] * self.exposure_s

    @property
    def blur_px(self) -> float:
        """Length of the motion blur, in pixels."""
        return hypot(*self.velocity_mps) * self.exposure_s / self.ground_resolution_m

    @property
    def blurred_pixel_m(self) -> float:
        """What a pixel covers on the ground in the direction of the motion: √(1 + blur_px²) pixels, in metres.

        A pixel one wide, smeared over b pixels, has the variance (1 + b²) / 12 of a pixel of that width.
        """
        return self.ground_resolution_m * hypot(1.0, self.blur_px)

    def pixel_across_m(self, east: float, north: float) -> float:
        """What a pixel covers on the ground across a line in this direction: √(g² + (b sin φ)²), in metres, with the
        ground resolution g, the motion blur b and the angle φ between them.

        Args:
            east: of a unit vector along the line.
            north: of the same.
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
