"""How label files say what is in a picture: one file a layout. All give the same raw images, unread pictures beside."""

from typing import Annotated

from pydantic import Field

from pavetwin.datasets.layouts.coco import CocoLayout
from pavetwin.datasets.layouts.masks import MaskLayout
from pavetwin.datasets.layouts.voc import VocLayout
from pavetwin.datasets.layouts.yolo import YoloLayout

AnyLayout = Annotated[VocLayout | YoloLayout | CocoLayout | MaskLayout, Field(discriminator="format")]
"""One of them, chosen by `format`."""

__all__ = ["AnyLayout", "CocoLayout", "MaskLayout", "VocLayout", "YoloLayout"]
