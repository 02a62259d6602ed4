"""A split dataset for the tools that train on it: YOLO (boxes and polygons) and COCO. Pictures are linked, not copied.

- `yolo`: `images/SPLIT`, `labels/SPLIT`, `data.yaml`. Ignored regions cannot be marked and are left out.
- `yolo-seg`: the same below `yolo-seg`, one polygon a line; only images whose labels all have an outline.
- `coco`: `annotations/instances_SPLIT.json`. Ignored regions have `iscrowd` 1 and run lengths of their box; one
  of no class is there once for each class, since COCO matches class by class. A label without outline has an empty
  `segmentation`: its mask is not known, and a rectangle would teach a wrong one.
"""

import json
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import link_or_copy, staging_folder, working_in, write_pieces
from pavetwin.labels.boxes import area
from pavetwin.labels.coco import annotation_row, coco_file, image_row, rings, run_lengths
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    class_names,
    read_image,
    write_description,
)
from pavetwin.labels.rle import encode
from pavetwin.labels.voc import PICTURES
from pavetwin.labels.yolo import box_line, data_yaml, polygon_line
from pavetwin.training.datasets.resuming import check_same, described, move_in
from pavetwin.training.datasets.splitting import split_names

FORMATS_OF_EXPORT: Final = ("yolo", "yolo-seg", "coco")

SEGMENTATION: Final = "yolo-seg"

DESCRIPTION: Final = "export.yaml"
"""File that names the exported dataset and split: files of two splits in one folder would mix train and test."""


def export(folder: Path, output: Path, formats: tuple[str, ...]) -> dict[str, int]:
    """Write a dataset's splits in formats; what is there already is written again.

    Returns:
        The number of images by format.

    Raises:
        PaveTwinError: a format is not known, the dataset is not split, the output holds another dataset or split, or
            it cannot be written.
    """
    for name in formats:
        if name not in FORMATS_OF_EXPORT:
            raise PaveTwinError(no_such("format", name, FORMATS_OF_EXPORT, key="`formats`"))
    names = split_names(folder)
    if output.resolve() == folder.resolve():
        raise PaveTwinError("The exported dataset needs a folder of its own.")
    splits = tuple(split for split, held in names.items() if held)
    counts = dict.fromkeys(formats, 0)
    held_by = sha256(json.dumps(names).encode()).hexdigest()
    made_by = {"made_by": "export", "dataset": described(folder), "split": held_by}
    with working_in(output):
        check_same(output, made_by, DESCRIPTION)
        write_description(output, made_by, DESCRIPTION)
        with staging_folder(output / "staging") as staging:
            for split in splits:
                for name in names[split]:
                    image = read_image(annotation_path(folder, name))
                    for each in formats:
                        counts[each] += _write_image(folder, output, staging, split, image, each)
        for split in splits if "coco" in formats else ():
            write_pieces(output / "annotations" / f"instances_{split}.json", _coco(folder, names, split))
        for each, inner in (("yolo", output), (SEGMENTATION, output / SEGMENTATION)):
            if each in formats:
                write_pieces(inner / "data.yaml", iter([data_yaml(splits)]))
    return counts


def _write_image(folder: Path, output: Path, staging: Path, split: str, image: AnnotatedImage, name: str) -> bool:
    """Write an image. Returns whether the format can hold it."""
    numbers = {category: at for at, category in enumerate(class_names())}
    lines: list[str] = []
    if name == SEGMENTATION:
        if any(each.outline is None for each in image.labelled):
            return False
        output = output / SEGMENTATION
        for each in image.labelled:
            assert each.category is not None
            assert each.outline is not None
            lines.append(polygon_line(numbers[each.category], each.outline, image.size_px))
    elif name == "yolo":
        labelled = ((each.category, each.box) for each in image.labelled if each.category is not None)
        lines = [box_line(numbers[category], box, image.size_px) for category, box in labelled]
    picture = output / "images" / split / image.picture
    if not picture.is_file():
        link_or_copy(folder / PICTURES / image.picture, picture)
    if name != "coco":
        labels = output / "labels" / split / f"{image.name}.txt"
        labels.parent.mkdir(parents=True, exist_ok=True)
        move_in(staging, labels, "".join(lines).encode())
    return True


def _coco(folder: Path, names: dict[str, list[str]], split: str) -> Iterator[bytes]:
    """The content of a split's COCO file. Images are read twice, so that memory holds one at a time."""
    first = 1 + sum(len(names[other]) for other in list(names)[: list(names).index(split)])
    images = (_coco_image(number, image) for number, image in _numbered(folder, names[split], first))
    annotations = (
        row for number, image in _numbered(folder, names[split], first) for row in _coco_annotations(number, image)
    )
    return coco_file(folder.absolute().name, images, annotations)


def _numbered(folder: Path, names: list[str], first: int) -> Iterator[tuple[int, AnnotatedImage]]:
    return ((number, read_image(annotation_path(folder, name))) for number, name in enumerate(names, first))


def _coco_image(number: int, image: AnnotatedImage) -> dict[str, Any]:
    return image_row(
        number,
        image.picture,
        image.size_px,
        gsd_mm=image.gsd_mm,
        source=image.source,
        group=image.group,
        is_background=image.is_background,
        attributes=dict(image.attributes),
    )


def _coco_annotations(number: int, image: AnnotatedImage) -> Iterator[dict[str, Any]]:
    """The rows of an image's annotations; a region without a class has one for each class."""
    named = (
        (each, name) for each in image.annotations for name in ((each.category,) if each.category else class_names())
    )
    numbers = {name: at for at, name in enumerate(class_names())}
    for place, (each, name) in enumerate(named):
        yield annotation_row(
            number * 10_000 + place,
            number,
            numbers[name],
            each.box,
            area_px=_area_px(each),
            segmentation=_segmentation(each, image.size_px),
            is_ignored=each.ignored is not None,
            ignored=each.ignored,
            original=each.original,
            attributes=dict(each.attributes),
        )


def _area_px(annotation: Annotation) -> float:
    """Area of the outline by the even-odd rule; of the box if there is no outline with an area."""
    if annotation.ignored is None and annotation.outline is not None:
        shown = float(shapely.area(shapely.make_valid(shapely.Polygon(annotation.outline))))
        if shown > 0:
            return round(shown, 2)
    return area(annotation.box)


def _segmentation(annotation: Annotation, size_px: tuple[int, int]) -> object:
    if annotation.ignored is None:
        return rings(annotation.outline) if annotation.outline is not None else []
    left, top, right, bottom = annotation.box
    mask = np.zeros(size_px[::-1], dtype=np.bool_)
    mask[top:bottom, left:right] = True
    return run_lengths(encode(mask), size_px)
