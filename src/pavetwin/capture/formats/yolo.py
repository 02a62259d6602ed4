"""Ultralytics YOLO: `labels/SPLIT/NAME.txt` beside `images/SPLIT/NAME.jpg`, and `data.yaml`.

A line is the class and the box's middle, width and height as shares of the image. An image without labels has an empty
file. Ignored objects are left out: the format cannot mark them.
"""

from collections.abc import Mapping

from pavetwin.capture.formats.base import Format, label_format
from pavetwin.capture.record import Record
from pavetwin.labels.classes import categories
from pavetwin.labels.yolo import box_line, data_yaml


@label_format("yolo")
class Yolo(Format):
    def of_image(self, record: Record) -> Mapping[str, bytes]:
        numbers = {category.name: category.number for category in categories()}
        lines = [box_line(numbers[obj.category], obj.box, record.size_px) for obj in record.labelled]
        return {f"labels/{record.split}/{record.name}.txt": "".join(lines).encode()}

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        return {"data.yaml": data_yaml(splits)}
