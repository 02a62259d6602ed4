"""Small drawn pictures of roads with their labels, as COCO: what a detector can learn within a minute."""

import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from pavetwin.labels.rle import encode

NAMES = ("Single Crack", "Crocodile Crack", "Pothole", "Person", "Car")
CATEGORIES = [
    {"id": at + 1, "name": name, "supercategory": "defect" if at < 3 else "traffic"} for at, name in enumerate(NAMES)
]


def drawn_roads(
    folder: Path,
    images: dict[str, int],
    size: tuple[int, int] = (128, 96),
    seed: int = 0,
    names: tuple[str, ...] = NAMES,
    synthetic: bool = False,
    repeats: int = 1,
) -> Path:
    """Write a dataset: split → number of images. Splits begin with the same pictures: `val` repeats those of `train`.

    Args:
        repeats: how often each picture of `train` is listed.
    """
    for split, count in images.items():
        rng = np.random.default_rng(seed)
        rows: list[dict[str, object]] = []
        held = []
        (folder / "images" / split).mkdir(parents=True)
        for number in range(count):
            picture, found = _road(rng, size, names)
            name = f"{number:03}.png"
            picture.save(folder / "images" / split / name)
            for _ in range(repeats if split == "train" else 1):
                image = len(held)
                held.append({"id": image, "file_name": name, "width": size[0], "height": size[1]})
                rows += [{"id": len(rows) + at, "image_id": image, **each} for at, each in enumerate(found, 1)]
        info = {"description": "PaveTwin synthetic images" if synthetic else "drawn roads"}
        content = {"info": info, "images": held, "annotations": rows, "categories": CATEGORIES}
        (folder / "annotations").mkdir(exist_ok=True)
        (folder / "annotations" / f"instances_{split}.json").write_text(json.dumps(content))
    return folder


def _road(
    rng: np.random.Generator, size: tuple[int, int], names: tuple[str, ...]
) -> tuple[Image.Image, list[dict[str, object]]]:
    """A picture with two things in it, side by side."""
    width, height = size
    grain = rng.normal(120, 4, (height, width, 1)).clip(0, 255).astype(np.uint8)
    picture = Image.fromarray(np.repeat(grain, 3, axis=2))
    found = []
    for at, name in enumerate(rng.choice(names, 2, replace=len(names) < 2)):
        left = at * width // 2 + int(rng.integers(4, 12))
        top = int(rng.integers(4, 24))
        right, bottom = left + int(rng.integers(26, 44)), top + int(rng.integers(26, 60))
        mask = Image.new("L", size)
        _draw(str(name), (left, top, right, bottom), ImageDraw.Draw(mask))
        colour = {"Person": (230, 60, 40), "Car": (40, 80, 220)}.get(str(name), (30, 30, 30))
        picture.paste(colour, mask=mask)
        filled = np.asarray(mask) > 0
        rows, columns = np.flatnonzero(filled.any(1)), np.flatnonzero(filled.any(0))
        box = [int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1]
        found.append(
            {
                "category_id": NAMES.index(str(name)) + 1,
                "bbox": box,
                "area": int(filled.sum()),
                "segmentation": {"size": [height, width], "counts": encode(filled)},
                "iscrowd": 0,
            }
        )
    return picture, found


def _draw(name: str, box: tuple[int, int, int, int], pen: ImageDraw.ImageDraw) -> None:
    left, top, right, bottom = box
    if name == "Single Crack":
        pen.line([(left, top), ((left + right) // 2 + 4, (top + bottom) // 2), (right, bottom)], fill=255, width=2)
    elif name == "Crocodile Crack":
        for step in range(0, max(right - left, bottom - top), 8):
            pen.line([(min(left + step, right), top), (min(left + step, right), bottom)], fill=255, width=2)
            pen.line([(left, min(top + step, bottom)), (right, min(top + step, bottom))], fill=255, width=2)
    elif name == "Person":
        pen.ellipse([left, top, left + 14, top + 14], fill=255)
    else:
        shape = pen.ellipse if name == "Pothole" else pen.rectangle
        shape([left, top, right, bottom], fill=255)
