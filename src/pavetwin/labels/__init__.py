"""What all labelled images share, rendered or photographed: classes, boxes, masks, and the three parts of a dataset."""

from typing import Final

SPLITS: Final = ("train", "val", "test")
"""Images to learn from, to choose settings by, and to measure with."""

CUT_OUT: Final = "cut_out"
"""Attribute of an object that was put into an image: the name of its cut-out."""
