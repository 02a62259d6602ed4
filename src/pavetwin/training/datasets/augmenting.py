"""Changed pictures, by Albumentations 2.0.8 (MIT).

This is the only file that knows the library: it is no longer maintained, and its successor has another licence.
Albumentations gets every value; it draws none but the noise, from a given seed.
"""

import os
from functools import cache
from importlib import import_module
from typing import Any, Final

import cv2
import numpy as np

from pavetwin.arrays import Float32Array, UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.changes import ImageChange, shown_window

FULL_SCALE: Final = 255.0


@cache
def albumentations() -> Any:
    """The library, which an extra installs.

    Raises:
        PaveTwinError: it is not installed; the message says how to get it.
    """
    # It asks for its newest version over the network otherwise.
    os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
    try:
        return import_module("albumentations")
    except ImportError as error:
        raise PaveTwinError(
            "Augmented images need Albumentations, which is not installed; get it with `pip install "
            "'pavetwin[augment]'`."
        ) from error


def changed_picture(picture: UInt8Array, change: ImageChange) -> UInt8Array:
    """The picture (height, width, 3) of a copy: see `pavetwin.training.datasets.changes`.

    Raises:
        PaveTwinError: Albumentations is not installed.
    """
    height, width = picture.shape[:2]
    steps: list[Any] = []
    if change.is_flipped:
        steps.append(albumentations().HorizontalFlip(p=1.0))
    if change.rotation_deg:
        left, top, right, bottom = shown_window((width, height), change.rotation_deg)
        angle = change.rotation_deg
        # The border shows only where interpolation reaches over it.
        steps.append(albumentations().Rotate(limit=(angle, angle), border_mode=cv2.BORDER_REFLECT_101, p=1.0))
        steps.append(albumentations().Crop(x_min=left, y_min=top, x_max=right, y_max=bottom, p=1.0))
    if change.brightness or change.contrast:
        # It scales about black; the picture's mean shall stay where it is.
        brightness = change.brightness - change.contrast * float(picture.mean()) / FULL_SCALE
        steps.append(
            albumentations().RandomBrightnessContrast(
                brightness_limit=(brightness, brightness), contrast_limit=(change.contrast, change.contrast), p=1.0
            )
        )
    if change.noise:
        steps.append(albumentations().GaussNoise(std_range=(change.noise, change.noise), p=1.0))
    # Of whole numbers it would cut off the noise towards zero.
    exact = np.divide(picture, FULL_SCALE, dtype=np.float32)
    result: Float32Array = albumentations().Compose(steps, seed=change.noise_seed)(image=exact)["image"]
    return np.rint(result.clip(0.0, 1.0) * FULL_SCALE).astype(np.uint8)
