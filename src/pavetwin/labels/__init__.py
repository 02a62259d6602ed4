"""Labels of images, rendered or photographed: classes, boxes, masks, label files, and the splits of a dataset."""

from typing import Final

SPLITS: Final = ("train", "val", "test")
"""Splits of a dataset: for training, for the choice of settings, and for measurement."""

CUT_OUT: Final = "cut_out"
"""Attribute of an object that was put into an image: the name of its cut-out."""
