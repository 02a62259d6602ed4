"""COCO files: the rows of images and annotations, masks as run lengths, and the file written in pieces.

Ignored objects have `iscrowd` 1: COCO's own evaluation neither rewards nor penalises them, and trainers leave them out.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pavetwin.files import json_bytes, json_rows
from pavetwin.labels.boxes import FloatBox, PixelBox
from pavetwin.labels.classes import categories


def coco_file(
    description: str, images: Iterable[Mapping[str, Any]], annotations: Iterable[Mapping[str, Any]]
) -> Iterator[bytes]:
    """The content of a file in pieces, so that memory holds one row at a time.

    Args:
        description: of the dataset.
        images: as `image_row` makes them.
        annotations: as `annotation_row` makes them.
    """
    kinds = [{"id": each.number + 1, "name": each.name, "supercategory": each.supercategory} for each in categories()]
    yield b'{"info": ' + json_bytes({"description": description, "version": "1"})
    yield b',\n"licenses": [],\n"categories": ' + json_bytes(kinds) + b',\n"images": [\n'
    yield from json_rows(images)
    yield b'\n],\n"annotations": [\n'
    yield from json_rows(annotations)
    yield b"\n]}\n"


def image_row(number: int, file_name: str, size_px: tuple[int, int], **details: object) -> dict[str, Any]:
    """The row of an image.

    Args:
        size_px: width, height.
        details: keys that are not COCO's own.
    """
    return {"id": number, "file_name": file_name, "width": size_px[0], "height": size_px[1], **details}


def annotation_row(
    number: int,
    image: int,
    category: int,
    box: PixelBox | FloatBox,
    *,
    area_px: float,
    segmentation: object = (),
    is_ignored: bool = False,
    **details: object,
) -> dict[str, Any]:
    """The row of an annotation.

    Args:
        number: unique in the file.
        category: number of the class, from 0.
        segmentation: `rings` or `run_lengths`; empty where the mask is not known.
        details: keys that are not COCO's own.
    """
    left, top, right, bottom = box
    return {
        "id": number,
        "image_id": image,
        "category_id": category + 1,
        "bbox": [left, top, round(right - left, 2), round(bottom - top, 2)],
        "area": area_px,
        "segmentation": segmentation or [],
        "iscrowd": int(is_ignored),
        **details,
    }


def rings(*polygons: Iterable[tuple[float, float]]) -> list[list[float]]:
    """A segmentation of polygons, each of corners (column, row) in pixels."""
    return [[side for corner in polygon for side in corner] for polygon in polygons]


def run_lengths(counts: str, size_px: tuple[int, int]) -> dict[str, Any]:
    """A segmentation of compressed run lengths (`encode`) over an image of (width, height)."""
    return {"size": [size_px[1], size_px[0]], "counts": counts}
