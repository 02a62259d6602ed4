"""Label files of a dataset for the tools that train on it: the formats, and their registry."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from pavetwin.capture.record import Record, read_records, record_paths
from pavetwin.labels.classes import categories
from pavetwin.labels.coco import annotation_row, coco_file, image_row, run_lengths
from pavetwin.labels.outlines import outline
from pavetwin.labels.rle import decode
from pavetwin.labels.voc import ANNOTATIONS, PICTURES, VocObject, voc_file
from pavetwin.labels.yolo import box_line, data_yaml, polygon_line
from pavetwin.registry import Registry

DESCRIPTION: Final = "PaveTwin synthetic images"  # Description of a capture in its COCO files

OCCLUDED: Final = 0.95
"""Visible fraction below which an object is occluded in VOC's sense: more than about 5 % of the box is covered."""

_IN_PIXEL: Final = 0.49
"""Offset of a point from its pixel's upper left corner: rounding and truncating readers find the same pixel."""


class Format:
    """One format of labels: files for each image, written with it, and files for a whole split or dataset, written
    last. A format defines those that it has."""

    def of_image(self, record: Record) -> Mapping[str, bytes]:
        """The files of one image: path in the dataset → content."""
        del record
        return {}

    def links(self, record: Record) -> tuple[str, ...]:
        """Further places in the dataset where the format's tools expect the picture."""
        del record
        return ()

    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        """The files for one split's images: path in the dataset, content in pieces.

        Args:
            folder: the dataset, with all its images.
        """
        del folder, split
        return iter(())

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        """The files for the whole dataset."""
        del splits
        return {}


FORMATS: Registry[type[Format]] = Registry(
    "label format", key="formats", group="pavetwin.formats", home="pavetwin.capture.formats"
)
label_format = FORMATS.register
"""Register a format under a name, which `formats` then takes."""


def find_formats(names: tuple[str, ...]) -> list[Format]:
    """The formats of these names.

    Raises:
        PaveTwinError: there is no such format; the message names the nearest.
    """
    return [FORMATS.get(name)() for name in dict.fromkeys(names)]


def _numbers() -> dict[str, int]:
    return {category.name: category.number for category in categories()}


@label_format("coco")
class Coco(Format):
    """COCO: `annotations/instances_SPLIT.json`, its `file_name`s in `images/SPLIT/`.

    Masks are run-length encoded, which is exact also for crack networks. `ignored` gives the reason of an ignored
    object.
    """

    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        images = (_coco_image(record) for record in read_records(folder, split))
        annotations = (row for record in read_records(folder, split) for row in _coco_annotations(record))
        yield f"annotations/instances_{split}.json", coco_file(DESCRIPTION, images, annotations)


def _coco_image(record: Record) -> dict[str, Any]:
    return image_row(
        record.index,
        f"{record.name}{record.suffix}",
        record.size_px,
        **({"gsd_mm": record.camera["gsd_mm"]} if "gsd_mm" in record.camera else {}),
        date_captured=record.light["utc"],
        camera=record.camera,
        light=record.light,
        traffic=record.traffic,
    )


def _coco_annotations(record: Record) -> Iterator[dict[str, Any]]:
    numbers = _numbers()
    for place, each in enumerate(record.objects):
        row = annotation_row(
            record.index * 10_000 + place + 1,  # unique over all splits and platforms
            record.index,
            numbers[each.category],
            each.box,
            area_px=each.area_px,
            segmentation=run_lengths(each.mask, record.size_px),
            is_ignored=each.ignored is not None,
            ignored=each.ignored,
            object_id=each.id,
            visible_fraction=each.visible_fraction,
            inside_fraction=each.inside_fraction,
            truncated=each.truncated,
            distance_m=each.distance_m,
            position_m=list(each.position_m),
        )
        yield row | each.details


@label_format("voc")
class Voc(Format):
    """Pascal VOC: `voc/Annotations/NAME.xml`, `voc/JPEGImages` with the pictures, `voc/ImageSets/Main/SPLIT.txt`."""

    def of_image(self, record: Record) -> Mapping[str, bytes]:
        objects = (
            VocObject(
                each.category,
                each.box,
                difficult=each.ignored is not None,
                truncated=each.truncated,
                occluded=each.visible_fraction < OCCLUDED,
                details={
                    "id": each.id,
                    "visible_fraction": each.visible_fraction,
                    "distance_m": each.distance_m,
                    **each.details,
                    "ignored": each.ignored,
                },
            )
            for each in record.objects
        )
        source = {"database": "PaveTwin", "annotation": "PaveTwin", "image": "rendered"}
        content = voc_file(f"{record.name}{record.suffix}", record.size_px, source, objects)
        return {f"voc/{ANNOTATIONS}/{record.name}.xml": content}

    def links(self, record: Record) -> tuple[str, ...]:
        return (f"voc/{PICTURES}/{record.name}{record.suffix}",)

    def of_split(self, folder: Path, split: str) -> Iterator[tuple[str, Iterator[bytes]]]:
        names = (f"{path.stem}\n".encode() for path in record_paths(folder, split))
        yield f"voc/ImageSets/Main/{split}.txt", names


@label_format("yolo")
class Yolo(Format):
    """Ultralytics YOLO: `labels/SPLIT/NAME.txt` next to `images/SPLIT/NAME.jpg`, and `data.yaml`.

    A line is the class and the box's middle, width and height as shares of the image. An image without labels has an
    empty file. Ignored objects are left out: the format cannot mark them.
    """

    def of_image(self, record: Record) -> Mapping[str, bytes]:
        numbers = _numbers()
        lines = [box_line(numbers[each.category], each.box, record.size_px) for each in record.labelled]
        return {f"labels/{record.split}/{record.name}.txt": "".join(lines).encode()}

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        return {"data.yaml": data_yaml(splits)}


@label_format("yolo-seg")
class YoloSeg(Format):
    """Ultralytics YOLO for segmentation: `yolo-seg/data.yaml`, with `labels/SPLIT/NAME.txt` and the pictures.

    A line is the class and one polygon in shares of the image (`labels.outlines`): Ultralytics takes one polygon for an
    instance, and joins parts by bridges in the same way. The format has a folder of its own, since Ultralytics looks
    for labels of boxes and of polygons at the same place.
    """

    FOLDER: Final = "yolo-seg"

    def of_image(self, record: Record) -> Mapping[str, bytes]:
        numbers, (width, height) = _numbers(), record.size_px
        lines = []
        for each in record.labelled:
            left, top, right, bottom = each.box
            mask = decode(each.mask, (height, width))[top:bottom, left:right]
            corners = (outline(mask) + (left + _IN_PIXEL, top + _IN_PIXEL)).tolist()
            lines.append(polygon_line(numbers[each.category], corners, record.size_px))
        return {f"{self.FOLDER}/labels/{record.split}/{record.name}.txt": "".join(lines).encode()}

    def links(self, record: Record) -> tuple[str, ...]:
        return (f"{self.FOLDER}/{record.image}",)

    def of_all(self, splits: tuple[str, ...]) -> Mapping[str, bytes]:
        return {f"{self.FOLDER}/data.yaml": data_yaml(splits)}
