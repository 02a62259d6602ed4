"""What a renderer gives back: the picture, and for every pixel how far away and what it shows."""

from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import Float32Array, UInt8Array, UInt32Array
from pavetwin.render.exposure import Exposure
from pavetwin.scene.view import View


@dataclass(frozen=True)
class RenderedFrame:
    """One picture with its truth. All arrays have the view's height and width; row 0 is the upper edge."""

    view: View
    rgb: UInt8Array
    """(height, width, 3) sRGB, as the sensor stored it."""
    depth_m: Float32Array | None
    """(height, width) along the camera's axis; inf where nothing is. None when not asked for."""
    labels: UInt32Array | None
    """(height, width): the label of what is seen (`scene.model.agent_label`, `defect_label`), 0 for all else."""
    amodal_px: dict[int, int]
    """Label → pixels of this image that it would cover if nothing that moves or stands hid it; empty without labels."""
    exposure: Exposure | None = None
    """How the camera was set."""
    defect_free: UInt8Array | None = None
    """(height, width, 3): `rgb` as it would be had the pavement no defects; None when not asked for."""

    def __post_init__(self) -> None:
        width, height = self.view.size_px
        if self.rgb.shape != (height, width, 3) or self.rgb.dtype != np.uint8:
            raise ValueError(f"rgb of a frame: {self.rgb.dtype} {self.rgb.shape}, expected uint8 {(height, width, 3)}")
        for name, array in (("depth_m", self.depth_m), ("labels", self.labels)):
            if array is not None and array.shape != (height, width):
                raise ValueError(f"{name} of a frame: {array.shape}, expected {(height, width)}")
