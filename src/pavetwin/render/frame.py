"""The renderer's result and its exposure: image, depth and labels; aperture, shutter time and ISO."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Float16Array, Float32Array, UInt8Array, UInt32Array
from pavetwin.scene.light import LUMINANCE
from pavetwin.scene.view import View
from pavetwin.uav.cameras import Camera

LENS_TRANSMISSION: Final = 0.9
"""Transmission of a coated lens (ISO 12232 uses 0.65 including falloff and angle, which are modelled separately)."""

METERED: Final = 0.185
"""The mean of an image as a share of what saturates the sensor. ISO 12232's 18 % grey lies at 0.127; drones expose
roads half a stop brighter: with 0.135 frames had a median lightness L* of 51, 272 photographs of RDD2022's China drone
subset have 61."""

LONGEST_S: Final = 1 / 400  # Longest shutter time in flight: beyond it the ISO is raised instead
_HIGHLIGHT: Final = 0.85  # The 99.5th percentile of an image is kept below this share of saturation


@dataclass(frozen=True)
class Exposure:
    """Exposure settings of one image."""

    shutter_s: float
    f_number: float
    iso: float

    def __post_init__(self) -> None:
        if min(self.shutter_s, self.f_number, self.iso) <= 0:
            raise ValueError(f"an exposure has a positive shutter time, f-number and ISO, not {self}")

    @property
    def share_per_light(self) -> float:
        """Share of saturation for each kcd/m²: H = π/4 · L · T · t / N², and ISO 12232: H_sat = 78 lx·s / ISO."""
        lux_seconds = math.pi / 4 * 1000 * LENS_TRANSMISSION * self.shutter_s / self.f_number**2
        return lux_seconds * self.iso / 78

    @property
    def value(self) -> float:
        """Exposure value at ISO 100: log₂(N² / t) − log₂(ISO / 100)."""
        return math.log2(self.f_number**2 / self.shutter_s) - math.log2(self.iso / 100)


def meter(radiance: Float16Array) -> float:
    """The share of saturation for each kcd/m² that suits an image (height, width, 4): its mean where a camera wants
    it, its highlights kept unless they are few."""
    seen = radiance[::8, ::8, :3].astype(np.float64) @ LUMINANCE
    seen = seen[np.isfinite(seen)]
    # Lamps and specular reflections of the sun do not measure the scene's brightness.
    mean = float(np.minimum(seen, 4 * np.median(seen) + 1e-9).mean())
    bright = float(np.quantile(seen, 0.995))
    return min(METERED / max(mean, 1e-6), 2.5 * METERED / max(mean, 1e-6), _HIGHLIGHT / max(bright, 1e-6))


def programme(camera: Camera, share_per_light: float) -> Exposure:
    """Settings that give this share of saturation for each kcd/m², within what the camera can do.

    At its lowest ISO and widest aperture first; where that needs a longer shutter than `LONGEST_S` the ISO goes up,
    where it needs a shorter one than the camera has the aperture closes.
    """
    lowest, highest = camera.iso
    widest, narrowest = camera.f_numbers
    shortest = camera.shortest_exposure_s or 1 / 8000
    iso, f_number = float(lowest), widest
    shutter = share_per_light / Exposure(1.0, f_number, iso).share_per_light
    if shutter > LONGEST_S:
        iso = min(iso * shutter / LONGEST_S, float(highest))
        shutter = share_per_light / Exposure(1.0, f_number, iso).share_per_light
    elif shutter < shortest:
        f_number = min(f_number * math.sqrt(shortest / shutter), narrowest)
        shutter = max(share_per_light / Exposure(1.0, f_number, iso).share_per_light, shortest)
    return Exposure(shutter, f_number, iso)


@dataclass(frozen=True)
class RenderedFrame:
    """One image with its ground truth. All arrays have the view's height and width; row 0 is the upper edge."""

    view: View
    rgb: UInt8Array
    """(height, width, 3) sRGB, as the sensor stored it."""
    depth_m: Float32Array | None
    """(height, width) along the camera's axis; inf where nothing is. None if not requested."""
    labels: UInt32Array | None
    """(height, width): the label of the visible object (`scene.values.agent_label`, `defect_label`), 0 for
    background."""
    amodal_px: dict[int, int]
    """Label → pixels of this image that the object would cover without occluders; empty without labels."""
    exposure: Exposure | None = None
    """The camera's exposure settings."""
    defect_free: UInt8Array | None = None
    """(height, width, 3): `rgb` of the same pavement without defects; None if not requested."""

    def __post_init__(self) -> None:
        width, height = self.view.size_px
        if self.rgb.shape != (height, width, 3) or self.rgb.dtype != np.uint8:
            raise ValueError(f"rgb of a frame: {self.rgb.dtype} {self.rgb.shape}, expected uint8 {(height, width, 3)}")
        for name, array in (("depth_m", self.depth_m), ("labels", self.labels)):
            if array is not None and array.shape != (height, width):
                raise ValueError(f"{name} of a frame: {array.shape}, expected {(height, width)}")
