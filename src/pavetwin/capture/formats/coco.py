"""COCO: `annotations/instances_SPLIT.json`, its `file_name`s in `images/SPLIT/`.

Masks are run-length encoded, which is exact also for crack networks. Ignored objects have `iscrowd` 1, which COCO's own
evaluation neither rewards nor penalises and trainers leave out; `ignored` gives the reason.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pavetwin.capture.formats.base import Format, label_format
from pavetwin.capture.record import Record, read_records
from pavetwin.files import json_bytes, json_rows
from pavetwin.labels.classes import categories


@label_format("coco")
class Coco(Format):
    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        yield f"annotations/instances_{split}.json", _content(folder, split)


def _content(folder: Path, split: str) -> Iterator[bytes]:
    """The file in pieces: the images are read twice, so that memory holds one at a time."""
    kinds = [
        {"id": category.number + 1, "name": category.name, "supercategory": category.supercategory}
        for category in categories()
    ]
    yield b'{"info": ' + json_bytes({"description": "PaveTwin synthetic images", "version": "1"})
    yield b',\n"licenses": [],\n"categories": ' + json_bytes(kinds) + b',\n"images": [\n'
    yield from json_rows(_image(record) for record in read_records(folder, split))
    yield b'\n],\n"annotations": [\n'
    yield from json_rows(each for record in read_records(folder, split) for each in _annotations(record))
    yield b"\n]}\n"


def _image(record: Record) -> dict[str, Any]:
    width, height = record.size_px
    return {
        "id": record.index,
        "file_name": f"{record.name}{record.suffix}",
        "width": width,
        "height": height,
        **({"gsd_mm": record.camera["gsd_mm"]} if "gsd_mm" in record.camera else {}),
        "date_captured": record.light["utc"],
        "camera": record.camera,
        "light": record.light,
        "traffic": record.traffic,
    }


def _annotations(record: Record) -> Iterator[dict[str, Any]]:
    numbers = {category.name: category.number + 1 for category in categories()}
    width, height = record.size_px
    for place, obj in enumerate(record.objects):
        left, top, right, bottom = obj.box
        yield {
            # Unique over all splits and platforms.
            "id": record.index * 10_000 + place + 1,
            "image_id": record.index,
            "category_id": numbers[obj.category],
            "bbox": [left, top, right - left, bottom - top],
            "area": obj.area_px,
            "segmentation": {"size": [height, width], "counts": obj.mask},
            "iscrowd": int(obj.ignored is not None),
            "ignored": obj.ignored,
            "object_id": obj.id,
            "visible_fraction": obj.visible_fraction,
            "inside_fraction": obj.inside_fraction,
            "truncated": obj.truncated,
            "distance_m": obj.distance_m,
            "position_m": list(obj.position_m),
            **obj.details,
        }
