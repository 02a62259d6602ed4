"""Layouts of label files, one module each. All yield the same raw images and leave the pictures unread."""

from typing import Annotated

from pydantic import Field

from pavetwin.training.datasets.layouts.coco import CocoLayout
from pavetwin.training.datasets.layouts.masks import MaskLayout
from pavetwin.training.datasets.layouts.voc import VocLayout
from pavetwin.training.datasets.layouts.yolo import YoloLayout

AnyLayout = Annotated[VocLayout | YoloLayout | CocoLayout | MaskLayout, Field(discriminator="format")]
"""One of them, chosen by `format`."""

__all__ = ["AnyLayout", "CocoLayout", "MaskLayout", "VocLayout", "YoloLayout"]
