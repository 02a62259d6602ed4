"""Ultralytics YOLO for segmentation: `yolo-seg/data.yaml`, beside it `labels/SPLIT/NAME.txt` and the pictures.

A line is the class and one polygon in shares of the image (`labels.outlines`): Ultralytics takes one polygon for an
instance, and joins parts by bridges in the same way. It has a folder of its own, since Ultralytics looks for labels of
boxes at the place where it looks for these.
"""

from collections.abc import Mapping

import numpy as np

from pavetwin.capture.formats.base import Format, label_format
from pavetwin.capture.record import Record
from pavetwin.capture.truth import LabelledObject
from pavetwin.labels.classes import categories
from pavetwin.labels.outlines import outline
from pavetwin.labels.rle import decode
from pavetwin.labels.yolo import data_yaml

FOLDER = "yolo-seg"

_IN_PIXEL = 0.49
"""Of a point from its pixel's upper left corner: readers that round and those that truncate find the same pixel."""


@label_format("yolo-seg")
class YoloSeg(Format):
    def of_image(self, record: Record) -> Mapping[str, bytes]:
        numbers = {category.name: category.number for category in categories()}
        lines = [f"{numbers[obj.category]} {_polygon(obj, record.size_px)}\n" for obj in record.labelled]
        return {f"{FOLDER}/labels/{record.split}/{record.name}.txt": "".join(lines).encode()}

    def links(self, record: Record) -> tuple[str, ...]:
        return (f"{FOLDER}/{record.image}",)

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        return {f"{FOLDER}/data.yaml": data_yaml(splits)}


def _polygon(obj: LabelledObject, size_px: tuple[int, int]) -> str:
    left, top, right, bottom = obj.box
    mask = decode(obj.mask, (size_px[1], size_px[0]))[top:bottom, left:right]
    shares = (outline(mask) + (left + _IN_PIXEL, top + _IN_PIXEL)) / size_px
    return " ".join(f"{share:.6f}" for share in np.minimum(shares, 1.0).ravel())
