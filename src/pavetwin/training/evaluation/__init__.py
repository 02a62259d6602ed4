"""Detections against labels: what a detector gets right and wrong, in numbers. PyTorch is not needed here."""
