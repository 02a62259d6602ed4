"""What the painted datasets hold."""

from pavetwin.capture.settings import CaptureSettings

UAV = CaptureSettings(
    platforms=("uav",), images=60, altitudes_m=(5.0, 6.0, 8.0), densities=("medium",), seed=3, size_px=(320, 320)
)
FEW = UAV.model_copy(update={"images": 20})
SPLITS = ("train", "val", "test")
