"""Small datasets in the published formats, made for a test: pictures and label files."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

Corners = tuple[int, int, int, int]


def picture(path: Path, size: tuple[int, int] = (64, 48), seed: int = 0) -> Path:
    """A picture with content of its own: coarse noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    grain = np.random.default_rng(seed).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    Image.fromarray(grain).resize(size, Image.Resampling.BICUBIC).save(path, quality=90)
    return path


def voc(path: Path, objects: list[tuple[str, Corners]], size: tuple[int, int] = (64, 48), filename: str = "") -> Path:
    """A VOC file; an object's name stands in lines 4, 7, 10, … ."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = [
        "<annotation>",
        f"<folder/><filename>{filename or path.stem + '.jpg'}</filename>",
        f"<size><width>{size[0]}</width><height>{size[1]}</height><depth>3</depth></size>",
    ]
    body = [
        f"<object><name>{name}</name><pose/><truncated/><difficult/>\n"
        f"<bndbox><xmin>{box[0]}</xmin><ymin>{box[1]}</ymin>\n"
        f"<xmax>{box[2]}</xmax><ymax>{box[3]}</ymax></bndbox></object>"
        for name, box in objects
    ]
    path.write_text("\n".join([*head, *body, "</annotation>"]), encoding="utf-8")
    return path


def yolo(path: Path, *lines: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def coco(path: Path, images: list[dict[str, object]], annotations: list[dict[str, object]], names: list[str]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    categories = [{"id": number, "name": name} for number, name in enumerate(names, 1)]
    path.write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}), "utf-8")
    return path
