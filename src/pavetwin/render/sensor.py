"""From light to the stored image: electrons, noise, white balance, tone curve. The pixels are computed in Rust."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin._core import expose
from pavetwin.arrays import Float16Array, Float32Array, UInt8Array, UInt32Array
from pavetwin.render.frame import Exposure
from pavetwin.scene.light import LUMINANCE, Light, harmonics
from pavetwin.scene.view import View
from pavetwin.uav.cameras import Camera

FULL_WELL_PER_UM2: Final = 2600.0
"""Electrons that a pixel holds for each µm² of its area: 15,000 on the 2.4 µm pixels of 1" sensors of the Phantom 4
Pro's kind (Sony IMX183, as camera makers measure it by EMVA 1288)."""

READ_NOISE: Final = 2.5  # Read noise of such a pixel in electrons, from the same measurements
_READ_PITCH_UM: Final = 2.4

NATIVE: Final = 1.4
"""A pixel of an image that covers fewer of the sensor's than this, along a side, counts as one of the sensor's."""

_PAVEMENT_WARMTH: Final = 0.08  # Logarithm of red over blue of aged asphalt and concrete under white light
SHARP_PX: Final = 0.3
"""Images in which nothing moves farther than this during the exposure get no motion blur."""


@dataclass(frozen=True)
class ImageProcessing:
    """Parameters of the camera's image processing; the defaults match the JPEG output of a consumer drone."""

    contrast: float = 1.12
    """Slope of the tone curve at middle grey over sRGB's."""
    saturation: float = 1.1
    adaptation: float = 0.9
    """How far the white balance goes from none (0) to fully neutral (1)."""
    sharpening: float = 0.5
    blur_px: float = 0.45
    """Standard deviation of the point spread of lens, pixels and demosaicing together."""
    vignetting: float = 0.14
    """Share of the cos⁴ falloff that the camera's correction leaves."""
    from_mosaic: bool = True
    """Whether images at the sensor's own pixels are made by the camera's `development`, instead of with the
    `blur_px` and `sharpening` above, which hold for images that are brought to fewer pixels."""


def stored_image(
    radiance: Float16Array,
    *,
    view: View,
    camera: Camera,
    light: Light,
    exposure: Exposure,
    seed: int,
    style: ImageProcessing,
    depth: Float32Array | None = None,
    labels: UInt32Array | None = None,
    velocities: Mapping[int, npt.ArrayLike] | None = None,
    white: tuple[float, float, float] | None = None,
) -> UInt8Array:
    """The image as a camera stores it, (height, width, 3) sRGB.

    Args:
        radiance: (height, width, 4) linear RGB, kcd/m².
        view: its pinhole, its place in the whole frame, and its velocity.
        light: that the white balance adapts to.
        depth: (height, width) metres along the axis, for motion blur; None for none.
        labels: (height, width), to look up velocities.
        velocities: label → (3,) m/s, world frame.
        white: gains of the white balance; None for automatic white balance.
    """
    pitch_um = camera.focal_mm / view.focal_px * 1000
    development = camera.development if style.from_mosaic and pitch_um < NATIVE * (camera.pitch_um or 0.0) else None
    wells = pitch_um**2 * FULL_WELL_PER_UM2 * camera.iso[0] / exposure.iso
    still = -(view.velocity_mps @ view.rotation) * exposure.shutter_s
    moving = {
        label: _three(still + np.asarray(velocity, dtype=np.float64) @ view.rotation * exposure.shutter_s)
        for label, velocity in (velocities or {}).items()
    }
    return expose(
        radiance.view(np.uint16),
        seed=seed,
        electrons_per_light=exposure.share_per_light * wells,
        full_electrons=wells,
        read_electrons=READ_NOISE * pitch_um / _READ_PITCH_UM,
        vignetting=style.vignetting,
        blur_px=development.lens_px if development else style.blur_px,
        white_balance=white or white_balance(light, radiance, style.adaptation),
        saturation=style.saturation,
        sharpening=development.sharpening if development else style.sharpening,
        curve=tone_curve(style.contrast),
        mosaic=(development.noise_reduction, development.colour_reach_px) if development else None,
        depth=depth,
        labels=labels if depth is not None else None,
        focal_px=view.focal_px,
        frame_px=view.whole_px,
        corner_px=view.corner_px,
        still_m=_three(still),
        moving_m=moving if depth is not None else {},
    )


def farthest_motion_px(
    view: View, exposure: Exposure, velocities: Mapping[int, npt.ArrayLike], nearest_m: float
) -> float:
    """At least how far anything moves in the image over the exposure [px]."""
    fastest = max((float(np.linalg.norm(np.asarray(each))) for each in velocities.values()), default=0.0)
    speed = fastest + float(np.linalg.norm(view.velocity_mps))
    return speed * exposure.shutter_s * view.focal_px / nearest_m


def white_balance(light: Light, radiance: Float16Array, adaptation: float) -> tuple[float, float, float]:
    """Gains of red, green and blue, none below 1, that turn grey objects in an image towards neutral.

    The illuminant lies between that of level ground in the sun and in the shade, nearer to the one that the image's
    light-weighted mean ratio of red to blue speaks for: a grey world, limited to real illuminants.
    """
    shade = light.sky_irradiance.T @ harmonics(np.array([0.0, 0.0, 1.0]))
    sun = light.sun_klux * light.to_sun[2] + shade
    seen = radiance[::8, ::8, :3].astype(np.float64).reshape(-1, 3)
    seen = np.maximum(seen[np.isfinite(seen).all(axis=1)], 0)
    sunny, shady = (math.log(each[0] / each[2]) for each in (sun, shade))
    # Lawns and red cars must not pull it beyond sun or shade; pavements are a little warm.
    ratios = np.log((seen[:, 0] + 1e-4) / (seen[:, 2] + 1e-4)) - _PAVEMENT_WARMTH
    ratios = np.clip(ratios, min(sunny, shady), max(sunny, shady))
    # Brighter pixels count more, as in cameras: with half a street in shade the sunlit half stays white. The weight is
    # limited to that at the brightest tenth, so that a white van does not outweigh the street.
    weight = seen @ LUMINANCE
    weight = np.minimum(weight, np.quantile(weight, 0.9)) + 1e-9 if len(weight) else weight
    mean = float(np.average(ratios, weights=weight)) if len(ratios) else 0.0
    share = float(np.clip((mean - sunny) / (shady - sunny), 0, 1)) if abs(shady - sunny) > 1e-3 else 0.0
    illuminant = np.exp((1 - share) * np.log(sun) + share * np.log(shade))
    gains = ((illuminant @ LUMINANCE) / illuminant) ** adaptation
    return _three(gains / gains.min())


@cache
def tone_curve(contrast: float) -> Float32Array:
    """Output 0 … 1 at inputs (i / 1023)²: sRGB's curve after a gain of 1.5 with a shoulder for highlights, `contrast`
    times as steep about middle grey."""
    share = np.linspace(0, 1, 1024) ** 2
    # A shoulder that starts at 0.5 and meets white at full saturation (Reinhard 2002, with a white point).
    lifted = 1.5 * share
    knee, top = 0.5, 1.5
    over = np.maximum(lifted - knee, 0) / (top - knee)
    shoulder = knee + (1 - knee) * over * (2 - over)
    linear = np.where(lifted > knee, shoulder, lifted)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    # An S about middle grey: x + k·sin, flat at black, grey and white.
    middle = 0.46
    bent = np.where(coded < middle, coded / middle, (coded - middle) / (1 - middle))
    swing = (contrast - 1) / math.pi * np.sin(math.pi * bent)
    out = coded + np.where(coded < middle, -middle * swing, (1 - middle) * swing)
    return np.asarray(np.clip(out, 0, 1), dtype=np.float32)


def _three(values: npt.ArrayLike) -> tuple[float, float, float]:
    x, y, z = np.asarray(values, dtype=np.float64)
    return float(x), float(y), float(z)
