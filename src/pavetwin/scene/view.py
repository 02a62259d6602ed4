"""A camera's pose and pinhole model, shared by renderers, labels and tests."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array
from pavetwin.uav.cameras import Camera


@dataclass(frozen=True)
class View:
    """A pinhole camera at one moment. Its own frame is x to the right, y down, z forward (as in OpenCV)."""

    position: Float64Array
    """(3,) of the centre of projection, world frame, metres."""
    rotation: Float64Array
    """(3, 3): its columns are the camera's x, y and z axes in the world frame."""
    size_px: tuple[int, int]
    """Width, height."""
    focal_px: float
    """Focal length in pixels."""
    velocity_mps: Float64Array = field(default_factory=lambda: np.zeros(3))
    """(3,) of the camera, world frame."""
    frame_px: tuple[int, int] | None = None
    """Width and height of the camera's whole frame that this is a crop of; None for a whole frame."""
    corner_px: tuple[int, int] = (0, 0)
    """Column and row of the crop's upper left pixel in the whole frame."""

    def __post_init__(self) -> None:
        if self.position.shape != (3,) or self.rotation.shape != (3, 3) or self.velocity_mps.shape != (3,):
            raise ValueError("a view needs a position (3,), a rotation (3, 3) and a velocity (3,)")
        if not np.allclose(self.rotation.T @ self.rotation, np.eye(3), atol=1e-6):
            raise ValueError("the rotation of a view is not orthonormal")
        far = np.add(self.corner_px, self.size_px)
        if min(self.corner_px) < 0 or (far > self.whole_px).any():
            raise ValueError(f"a crop to column and row {far.tolist()} leaves its frame of {self.whole_px}")

    @property
    def whole_px(self) -> tuple[int, int]:
        """Width and height of the whole frame."""
        return self.frame_px or self.size_px

    @property
    def principal_px(self) -> Float64Array:
        """(2,) the pixel that the axis goes through: the middle of the whole frame, which may lie outside a crop."""
        return np.array(self.whole_px) / 2 - self.corner_px

    def crop(self, corner_px: tuple[int, int], size_px: tuple[int, int]) -> "View":
        """A part of this view's image, pixel by pixel the same.

        Args:
            corner_px: column and row of its upper left pixel.
            size_px: width, height.

        Raises:
            ValueError: it leaves the image.
        """
        left, top = (int(sum(each)) for each in zip(self.corner_px, corner_px, strict=True))
        return replace(self, size_px=size_px, frame_px=self.whole_px, corner_px=(left, top))

    def to_camera(self, points: npt.ArrayLike) -> Float64Array:
        """World points (..., 3) in the camera's frame (..., 3), metres."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.position) @ self.rotation)

    def project(self, points: npt.ArrayLike) -> Float64Array:
        """World points (..., 3) to pixels (..., 2): (0, 0) is the image's upper left corner. NaN behind the camera."""
        seen = self.to_camera(points)
        depth = np.where(seen[..., 2] > 1e-9, seen[..., 2], np.nan)
        return np.asarray(seen[..., :2] / depth[..., None] * self.focal_px + self.principal_px)

    def rays(self, pixels: npt.ArrayLike) -> Float64Array:
        """Directions (..., 3) in the world frame through pixels (..., 2), their component along the axis 1."""
        plane = (np.asarray(pixels, dtype=np.float64) - self.principal_px) / self.focal_px
        return np.asarray(np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1) @ self.rotation.T)

    def ground(self, pixels: npt.ArrayLike) -> Float64Array:
        """Where the rays through pixels (..., 2) meet the level ground: (..., 2), NaN where they do not."""
        rays = self.rays(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (0.0 - self.position[2]) / rays[..., 2]
        reach = np.where(reach > 0, reach, np.nan)
        return np.asarray(self.position[:2] + rays[..., :2] * reach[..., None])

    def ground_resolution_m(self, pixels: npt.ArrayLike) -> Float64Array:
        """Side of the level ground under pixels (..., 2): the root of the area (...), metres; NaN where they show none.

        With the ray's component c downwards, its component along the axis being 1, that is h / (f c^1.5).
        """
        down = -self.rays(pixels)[..., 2]
        down = np.where(down > 0, down, np.nan)
        return np.asarray(self.position[2] / (self.focal_px * down**1.5))


def look(
    position: npt.ArrayLike,
    *,
    yaw_rad: float,
    pitch_rad: float,
    size_px: tuple[int, int],
    vertical_fov_rad: float,
    velocity_mps: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> View:
    """A view along a heading.

    Args:
        position: (3,) metres, world frame.
        yaw_rad: of the image's upward direction (for nadir) and the axis's heading otherwise, anticlockwise from east.
        pitch_rad: of the axis: 0 level, −π/2 straight down.
        size_px: width, height.
        vertical_fov_rad: field of view over the image's height.
        velocity_mps: (3,) of the camera.
    """
    forward_flat = np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
    right = np.array([math.sin(yaw_rad), -math.cos(yaw_rad), 0.0])
    forward = math.cos(pitch_rad) * forward_flat + np.array([0.0, 0.0, math.sin(pitch_rad)])
    down = np.cross(forward, right)
    return View(
        position=np.asarray(position, dtype=np.float64),
        rotation=np.stack([right, down, forward], axis=1),
        size_px=size_px,
        focal_px=size_px[1] / (2 * math.tan(vertical_fov_rad / 2)),
        velocity_mps=np.asarray(velocity_mps, dtype=np.float64),
    )


def nadir(
    camera: Camera,
    position: npt.ArrayLike,
    *,
    yaw_rad: float,
    size_px: tuple[int, int] | None = None,
    velocity_mps: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> View:
    """A camera of the database looking straight down, the upper edge of its image towards `yaw_rad`."""
    return look(
        position,
        yaw_rad=yaw_rad,
        pitch_rad=-math.pi / 2,
        size_px=size_px or camera.image_px,
        vertical_fov_rad=camera.fov_rad,
        velocity_mps=velocity_mps,
    )
