"""Ultralytics YOLO: `labels/SPLIT/NAME.txt` beside `images/SPLIT/NAME.jpg`, and `data.yaml`.

A line is the class and the box's middle, width and height as shares of the image. An image without labels has an empty
file. Ignored objects are left out: the format cannot mark them.
"""

from collections.abc import Mapping

import yaml

from pavetwin.capture.formats.base import Format, label_format
from pavetwin.capture.record import Record
from pavetwin.labels.classes import categories


@label_format("yolo")
class Yolo(Format):
    def of_image(self, record: Record) -> Mapping[str, bytes]:
        numbers = {category.name: category.number for category in categories()}
        width, height = record.size_px
        lines = []
        for obj in record.labelled:
            left, top, right, bottom = obj.box
            middle = ((left + right) / 2 / width, (top + bottom) / 2 / height)
            shares = (*middle, (right - left) / width, (bottom - top) / height)
            lines.append(f"{numbers[obj.category]} " + " ".join(f"{share:.6f}" for share in shares) + "\n")
        return {f"labels/{record.split}/{record.name}.txt": "".join(lines).encode()}

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        return {"data.yaml": data_yaml(splits)}


def data_yaml(splits: tuple[str, ...]) -> bytes:
    """The file that Ultralytics opens. Without `path` it looks beside this file, wherever the dataset is moved to. It
    requires train and val, which may be null."""
    content = {split: f"images/{split}" if split in splits else None for split in ("train", "val", *splits)}
    names = {category.number: category.name for category in categories()}
    return yaml.safe_dump(content | {"names": names}, sort_keys=False).encode()
