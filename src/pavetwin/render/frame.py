"""The renderer's result: the picture, and for every pixel its depth and label."""

from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import Float32Array, UInt8Array, UInt32Array
from pavetwin.render.exposure import Exposure
from pavetwin.scene.view import View


@dataclass(frozen=True)
class RenderedFrame:
    """One picture with its ground truth. All arrays have the view's height and width; row 0 is the upper edge."""

    view: View
    rgb: UInt8Array
    """(height, width, 3) sRGB, as the sensor stored it."""
    depth_m: Float32Array | None
    """(height, width) along the camera's axis; inf where nothing is. None if not requested."""
    labels: UInt32Array | None
    """(height, width): the label of the visible object (`scene.model.agent_label`, `defect_label`), 0 for
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
