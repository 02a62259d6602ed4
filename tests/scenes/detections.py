"""Small datasets of labels alone, and detections of them, written as the files that an evaluation reads."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pavetwin.training.evaluation.detections import FoundBox, read_detections
from pavetwin.training.evaluation.labelled import LabelledSplit, read_split

CRACK, CROCODILE, POTHOLE, PERSON, CAR, RUT = range(1, 7)
"""Categories in these files; the last is a class of the user's own."""

BOX, FAR = (10.0, 10.0, 40.0, 30.0), (100.0, 100.0, 40.0, 30.0)
"""Left, top, width, height."""

_NAMES = ("Single Crack", "Crocodile Crack", "Pothole", "Person", "Car", "Rut")


def true(category: int, box: Sequence[float] = BOX, *, ignored: bool = False, **facts: Any) -> dict[str, Any]:
    return {"category_id": category, "bbox": list(box), "iscrowd": int(ignored), **facts}


def said(
    image: int, category: int, box: Sequence[float] = BOX, det: float = 0.9, cls: float = 1.0, **attributes: float | str
) -> dict[str, Any]:
    parts = {"det_conf": det, "cls_conf": cls} if category <= POTHOLE else {"det_conf": det}
    score = det * parts.get("cls_conf", 1.0)
    attributes = {**parts, **attributes}
    return {"image_id": image, "category_id": category, "bbox": list(box), "score": score, "attributes": attributes}


def write_labels(
    folder: Path, images: Sequence[Sequence[dict[str, Any]]], facts: Sequence[dict[str, Any]] = (), split: str = "test"
) -> Path:
    """Images by their objects, numbered from 1, those of `val` from 501; annotations from 10 000 × image."""
    first = 501 if split == "val" else 1
    held = [
        {
            "id": first + at,
            "file_name": f"{first + at:03}.png",
            "width": 200,
            "height": 200,
            **(facts[at] if facts else {}),
        }
        for at in range(len(images))
    ]
    rows = [
        {"id": 10_000 * image["id"] + at, "image_id": image["id"], "area": each["bbox"][2] * each["bbox"][3], **each}
        for image, objects in zip(held, images, strict=True)
        for at, each in enumerate(objects)
    ]
    kinds = [{"id": at, "name": name, "supercategory": "defect" if at in (1, 2, 3, 6) else "agent"}
             for at, name in enumerate(_NAMES, 1)]  # fmt: skip
    info = {"description": "PaveTwin synthetic images"}
    content = {"info": info, "images": held, "annotations": rows, "categories": kinds}
    (folder / "annotations").mkdir(parents=True, exist_ok=True)
    (folder / "annotations" / f"instances_{split}.json").write_text(json.dumps(content))
    return folder


def write_detections(path: Path, rows: Sequence[dict[str, Any]]) -> Path:
    path.write_text(json.dumps(rows))
    return path


def scene(
    folder: Path, images: Sequence[Sequence[dict[str, Any]]], rows: Sequence[dict[str, Any]], **options: Any
) -> tuple[LabelledSplit, tuple[FoundBox, ...]]:
    """A split and the detections in it, through their files."""
    split = read_split(write_labels(folder, images, **options), "test")
    return split, read_detections(write_detections(folder / "found.json", rows), (split,))
