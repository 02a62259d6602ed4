"""Images of a drawn ground resolution: crops of the camera's whole frame at its own resolution, as real sets are cut.

The resolution decides the altitude: a camera of focal length f pixels covers h / f with a pixel from h metres.
"""

from typing import TYPE_CHECKING, Final

import numpy as np

from pavetwin.capture.defect_index import AIMED_PIXEL_M
from pavetwin.config.mission import CEILING_M, LOWEST_M
from pavetwin.errors import PaveTwinError
from pavetwin.uav.cameras import Camera, find_camera

if TYPE_CHECKING:
    from pavetwin.capture.settings import CaptureSettings
    from pavetwin.scene.view import View

ROUNDING: Final = 1e-9
"""Share by which a number may be above a bound that was computed: 13.3 mm are taken where 13.299999999999999 are."""

EVEN: Final = 0.2
"""An image has one ground resolution where that of its corners differs from its middle's by no more than this share."""


def drawn_gsd_mm(bounds_mm: tuple[float, float], share: float) -> float:
    """Ground resolution at a share (0 … 1) of a log-uniform distribution over a range, millimetres a pixel.

    Log-uniform: as many images between 2 and 4 mm as between 4 and 8, since an object's size in pixels goes by ratios.
    """
    low, high = bounds_mm
    return float(low * (high / low) ** share)


def native_focal_px(camera: Camera) -> float:
    """Focal length in pixels of the camera's whole frame."""
    return float(camera.image_px[1] / (2 * np.tan(camera.fov_rad / 2)))


def image_gsd_mm(view: "View") -> float | None:
    """The ground resolution in an image's middle, millimetres a pixel; None where it varies much over the image, or
    where that shows no ground."""
    width, height = view.size_px
    places = np.array([[width / 2, height / 2], [0, 0], [width, 0], [0, height], [width, height]])
    middle, *corners = (1000 * view.ground_resolution_m(places)).tolist()
    return round(middle, 4) if all(abs(each - middle) <= EVEN * middle for each in corners) else None


def check_resolution(settings: "CaptureSettings") -> None:
    """Check that the camera reaches the ground resolutions of the settings, and has as many pixels as the crops.

    Raises:
        PaveTwinError: it does not.
    """
    if settings.gsd_mm is None:
        return
    camera = find_camera(settings.camera)
    (low, high), focal = settings.gsd_mm, native_focal_px(camera)
    finest, highest = 1000 * LOWEST_M / focal, 1000 * CEILING_M / focal
    coarsest = min(highest, 1000 * AIMED_PIXEL_M) if settings.empty < 1 else highest
    if low < finest or high > coarsest * (1 + ROUNDING):
        at_m, limit = (LOWEST_M, finest) if low < finest else (coarsest * focal / 1000, coarsest)
        why = "the lowest altitude" if low < finest else "the highest"
        if low >= finest and coarsest < highest:
            why += " at which defects are seen"
        raise PaveTwinError(
            f"`gsd_mm` {low:g} {high:g}: a pixel of the camera '{settings.camera}' covers {limit:.3g} mm from "
            f"{at_m:.3g} m, {why}; choose between {np.ceil(100 * finest) / 100:g} and "
            f"{np.floor(100 * coarsest) / 100:g} mm, or another `camera`."
        )
    if any(np.greater(settings.size_px, camera.image_px)):
        width, height = settings.size_px
        raise PaveTwinError(
            f"`size_px` {width}x{height}: more than the {'x'.join(map(str, camera.image_px))} pixels of the camera "
            f"'{settings.camera}', of which images with `gsd_mm` are crops."
        )
