"""Ultralytics' text files: a line for an object, and the file that names the classes."""

from collections.abc import Iterable

import yaml

from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.classes import categories


def box_line(number: int, box: PixelBox, size_px: tuple[int, int]) -> str:
    """The class's number, and the box's middle, width and height as shares of an image of (width, height)."""
    left, top, right, bottom = box
    width, height = size_px
    middle = ((left + right) / 2 / width, (top + bottom) / 2 / height)
    return _line(number, (*middle, (right - left) / width, (bottom - top) / height))


def polygon_line(number: int, corners: Iterable[tuple[float, float]], size_px: tuple[int, int]) -> str:
    """The class's number, and the corners (column, row) in pixels as shares of an image of (width, height)."""
    width, height = size_px
    return _line(number, (share for x, y in corners for share in (min(x / width, 1.0), min(y / height, 1.0))))


def _line(number: int, shares: Iterable[float]) -> str:
    return f"{number} " + " ".join(f"{share:.6f}" for share in shares) + "\n"


def data_yaml(splits: tuple[str, ...]) -> bytes:
    """The file that Ultralytics opens. Without `path` it reads images next to this file, wherever the dataset is. It
    requires train and val, which may be null."""
    content = {split: f"images/{split}" if split in splits else None for split in ("train", "val", *splits)}
    names = {category.number: category.name for category in categories()}
    return yaml.safe_dump(content | {"names": names}, sort_keys=False).encode()
