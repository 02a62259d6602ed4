"""Label files for the tools that train on them. One file a format, one registry."""

from pavetwin.capture.formats.base import Format, find_formats, label_format
from pavetwin.capture.formats.coco import Coco
from pavetwin.capture.formats.voc import Voc
from pavetwin.capture.formats.yolo import Yolo

__all__ = ["Coco", "Format", "Voc", "Yolo", "find_formats", "label_format"]
