"""The detector in use, from its ONNX file (`pip install pavetwin[detect]`): no PyTorch is needed."""

from pavetwin.perception.inference.detections import Detections
from pavetwin.perception.inference.detector import Detector

__all__ = ["Detections", "Detector"]
