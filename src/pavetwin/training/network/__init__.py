"""The network of the detector: layers, heads, losses and detections, in PyTorch."""
