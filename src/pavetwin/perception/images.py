"""Images to search: files, folders and videos as pixels, with their poses."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import BinaryIO, Final

import cv2
import numpy as np
from PIL import Image, ImageOps

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.files import PICTURE_SUFFIXES
from pavetwin.perception.measuring import check_size
from pavetwin.perception.photograph import PhotographPose, pose_of

ImageLike = str | Path | Image.Image | UInt8Array
"""A file, a Pillow image, or pixels (rows, columns, 3) of red, green and blue."""

LARGEST_PX: Final = 500_000_000
"""Most pixels of a file."""

_LIMIT = Lock()


def of_any_size(file: str | Path | BinaryIO, kinds: tuple[str, ...] | None = None) -> Image.Image:
    """Open an image of any size without reading its pixels; the caller applies its own limit.

    Args:
        kinds: accepted formats by Pillow's names; None for all.

    Raises:
        OSError, ValueError, SyntaxError: it is not an image (from `PIL.Image.open`).
    """
    # Pillow refuses large images by one limit for the whole process.
    with _LIMIT, warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        usual, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(file, formats=kinds)
        finally:
            Image.MAX_IMAGE_PIXELS = usual


def opened(file: str | Path) -> Image.Image:
    """Open an image without reading its pixels.

    Raises:
        PaveTwinError: it is not an image, or too large.
    """
    try:
        held = of_any_size(file)
    except (OSError, ValueError, SyntaxError) as error:
        raise PaveTwinError(f"'{file}' cannot be read as an image ({error}).") from error
    width, height = held.size
    if width * height > LARGEST_PX:
        raise PaveTwinError(
            f"'{file}' has {width} × {height} pixels; at most {LARGEST_PX // 10**6} million are read; split it."
        )
    return held


def pixels_of(image: ImageLike) -> UInt8Array:
    """An image as red, green and blue (rows, columns, 3), turned by its EXIF orientation.

    Raises:
        PaveTwinError: it cannot be read as an image, or is too large.
    """
    if isinstance(image, np.ndarray):
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
            raise PaveTwinError("An image as an array is uint8 of (rows, columns, 3): red, green, blue.")
        return image
    held = opened(image) if isinstance(image, str | Path) else image
    try:
        return np.asarray(ImageOps.exif_transpose(held).convert("RGB"))
    # Pillow's decoders raise nearly anything for damaged files.
    except Exception as error:
        what = f"'{image}'" if isinstance(image, str | Path) else "The image"
        raise PaveTwinError(f"{what} cannot be read as an image ({error}).") from error


VIDEOS: Final = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm"})

_WRITTEN: Final = {("inventory.csv",): ("crops", "crops-*.jpg"), ("detections.csv", "coco.json"): ("pictures",)}
"""Images that `pavetwin inventory` and `pavetwin detect` write, by the files next to them."""


@dataclass(frozen=True, slots=True)
class SourceImage:
    """One image to search."""

    name: str
    """Path within the folder, or the video's name with the frame's number."""
    read: Callable[[], tuple[UInt8Array, PhotographPose | None]]
    """Reads its pixels and pose; raises a `PaveTwinError` if it cannot be read."""
    share: float
    """Share of the source before it, 0 … 1."""
    part: float = 0.0
    """Its own share of the source, 0 … 1."""


def source_images(source: Path, every_s: float = 1.0, output: Path | None = None) -> Iterator[SourceImage]:
    """The images of a source, one at a time, without those that an inventory or a detection wrote into a folder.

    Args:
        source: an image, a video, or a folder of images.
        every_s: seconds between the frames of a video; 0 takes every frame.
        output: folder of the results; images in it are skipped.

    Raises:
        PaveTwinError: there is no such source, or nothing in it.
    """
    check_size("every_s", every_s, may_be_zero=True)
    if source.is_dir():
        return _of_folder(source, output)
    if not source.is_file():
        raise PaveTwinError(f"There is no image, video or folder '{source}'.")
    if source.suffix.lower() in VIDEOS:
        return _of_video(source, every_s)
    return iter((SourceImage(source.name, lambda: read_photograph(source), 0.0, 1.0),))


def _of_folder(folder: Path, output: Path | None) -> Iterator[SourceImage]:
    written = _written(folder)
    if output is not None and folder.resolve() in output.resolve().parents:
        written.add(folder / output.resolve().relative_to(folder.resolve()))
    files = sorted(
        each
        for each in folder.rglob("*")
        if each.suffix.lower() in PICTURE_SUFFIXES and written.isdisjoint((each, *each.parents)) and each.is_file()
    )
    if not files:
        kinds = ", ".join(sorted(each.removeprefix(".") for each in PICTURE_SUFFIXES))
        raise PaveTwinError(f"There is no image in '{folder}' or the folders within ({kinds}).")
    return (
        SourceImage(
            file.relative_to(folder).as_posix(),
            lambda file=file: read_photograph(file),  # type: ignore[misc]
            at / len(files),
            1 / len(files),
        )
        for at, file in enumerate(files)
    )


def _written(folder: Path) -> set[Path]:
    """Images and folders of images in a folder that are results."""
    return {
        path
        for files, patterns in _WRITTEN.items()
        for first in folder.rglob(files[0])
        if all(first.with_name(name).is_file() for name in files)
        for pattern in patterns
        for path in first.parent.glob(pattern)
    }


def read_photograph(file: Path) -> tuple[UInt8Array, PhotographPose]:
    """Pixels and pose of an image file.

    Raises:
        PaveTwinError: it cannot be read as an image.
    """
    pixels = pixels_of(file)
    with opened(file) as held:
        return pixels, pose_of(held)


def _of_video(file: Path, every_s: float) -> Iterator[SourceImage]:
    film = cv2.VideoCapture(str(file))
    if not film.isOpened():
        raise PaveTwinError(f"'{file}' cannot be read as a video.")
    return _frames(film, file.stem, every_s)


def _frames(film: cv2.VideoCapture, name: str, every_s: float) -> Iterator[SourceImage]:
    rate, count = film.get(cv2.CAP_PROP_FPS) or 25.0, film.get(cv2.CAP_PROP_FRAME_COUNT)
    step = max(1, round(every_s * rate))
    at = 0
    try:
        while film.grab():
            if at % step == 0:
                is_whole, frame = film.retrieve()
                if not is_whole:
                    break
                pixels = np.ascontiguousarray(frame[:, :, ::-1], dtype=np.uint8)
                share = min(1.0, at / count) if count > 0 else 0.0
                yield SourceImage(f"{name}-{at:06}.jpg", lambda pixels=pixels: (pixels, None), share)  # type: ignore[misc]
            at += 1
    finally:
        film.release()
