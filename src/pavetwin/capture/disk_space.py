"""How much room a dataset takes, so that a disk too small is noticed before the first image and not after an hour."""

import shutil
from pathlib import Path
from typing import Final

import numpy as np

from pavetwin.capture.settings import CaptureSettings
from pavetwin.errors import PaveTwinError

_JPEG: Final = ((50, 75, 92, 100), (0.09, 0.14, 0.28, 1.2))
"""Qualities of JPEG, and the bytes a pixel takes at each: means over 24 images of both platforms."""

_PNG: Final = 1.5
_TEXT_BYTES: Final = 15_000
"""An image's record and labels."""


def bytes_of(settings: CaptureSettings, images: int) -> float:
    """About how many bytes that many images take with their labels."""
    width, height = settings.size_px
    per_px = _PNG if settings.picture == "png" else float(np.interp(settings.quality, *_JPEG))
    return images * (width * height * per_px + _TEXT_BYTES)


def check_disk_space(settings: CaptureSettings, images: int, folder: Path) -> None:
    """Look whether that many images fit beside what is there.

    Raises:
        PaveTwinError: they do not.
    """
    place = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists())
    needed, free = bytes_of(settings, images), shutil.disk_usage(place).free
    if needed > free:
        raise PaveTwinError(
            f"{images} images take about {_said(needed)}, and {_said(free)} are free where '{folder}' would be; "
            "free some space, choose another folder, or ask for fewer --images."
        )


def _said(size: float) -> str:
    return f"{size / 1e9:,.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"
