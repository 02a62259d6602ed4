"""Small datasets in the published formats, made for a test: pictures and label files."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

Corners = tuple[int, int, int, int]


def picture(path: Path, size: tuple[int, int] = (64, 48), seed: int = 0) -> Path:
    """A picture with content of its own: coarse noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    grain = np.random.default_rng(seed).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    Image.fromarray(grain).resize(size, Image.Resampling.BICUBIC).save(path, quality=90)
    return path


def pavement(size: tuple[int, int], seed: int = 0, brightness: float = 120.0) -> NDArray[np.uint8]:
    """(height, width, 3) Grey road with a fine grain."""
    grain = np.random.default_rng(seed).normal(brightness, 5.0, (size[1], size[0], 1))
    return np.repeat(grain, 3, axis=2).clip(0, 255).astype(np.uint8)


def with_car(
    picture: NDArray[np.uint8], middle: tuple[float, float], length_px: float, angle_deg: float = 0.0
) -> NDArray[np.uint8]:
    """The picture with a red car, 2.5 times as long as wide, with dark windows; turned clockwise from the columns."""
    drawn = Image.fromarray(picture)
    pen = ImageDraw.Draw(drawn)
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    ends = ((-0.5, -0.1), (-0.38, -0.2), (0.38, -0.2), (0.5, -0.1))
    body = (*ends, *((x, -y) for x, y in reversed(ends)))
    window = ((-0.26, -0.1), (-0.2, -0.1), (-0.2, 0.1), (-0.26, 0.1))
    for corners, colour in ((body, (190, 30, 35)), (window, (40, 40, 60))):
        turned = [
            (middle[0] + length_px * (x * c - y * s), middle[1] + length_px * (x * s + y * c)) for x, y in corners
        ]
        pen.polygon(turned, fill=colour)
    return np.array(drawn)


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
