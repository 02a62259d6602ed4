"""How much disk space a dataset takes, so that a full disk is reported before the first image is taken."""

import shutil
from pathlib import Path
from typing import Final

import numpy as np

from pavetwin.capture.settings import CaptureSettings
from pavetwin.errors import PaveTwinError

_JPEG: Final = ((50, 75, 92, 100), (0.09, 0.14, 0.28, 1.2))
"""JPEG qualities, and the bytes per pixel at each: means over 24 images of both platforms."""

_PNG: Final = 1.5
_TEXT_BYTES: Final = 15_000
"""An image's record and labels."""


def bytes_of(settings: CaptureSettings, images: int) -> float:
    """Estimated bytes of that many images with their labels."""
    width, height = settings.size_px
    per_px = _PNG if settings.picture == "png" else float(np.interp(settings.quality, *_JPEG))
    return images * (width * height * per_px + _TEXT_BYTES)


def check_disk_space(settings: CaptureSettings, images: int, folder: Path) -> None:
    """Check that that many images fit on the disk.

    Raises:
        PaveTwinError: they do not.
    """
    place = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists())
    needed, free = bytes_of(settings, images), shutil.disk_usage(place).free
    if needed > free:
        raise PaveTwinError(
            f"{images} images take about {_said(needed)}, and {_said(free)} are free where '{folder}' would be; "
            "free some space, choose another folder, or request fewer `images`."
        )


def _said(size: float) -> str:
    return f"{size / 1e9:,.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"
