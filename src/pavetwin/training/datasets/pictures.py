"""Pictures from anywhere, opened with care, and found by the names of their label files."""

import os
import struct
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Final
from unicodedata import normalize

import numpy as np
from PIL import Image

from pavetwin.files import PICTURE_SUFFIXES

_FORMATS: Final = ("JPEG", "PNG", "BMP", "TIFF", "WEBP")
"""Pillow's other readers, some of which start programs, are never asked."""

LARGEST_PX: Final = 100_000_000  # Most pixels of a picture; a larger one is refused before it is decompressed

_CONTAINERS: Final = frozenset(
    {"images", "image", "jpegimages", "img", "labels", "label", "annotations", "annotation", "xmls", "xml", "txt"}
)
"""Sibling folders of pictures and labels: their names do not distinguish pictures."""

_ORIENTATIONS: Final = range(1, 9)  # Values of EXIF's orientation
_TURNED: Final = frozenset({5, 6, 7, 8})  # EXIF orientations that swap width and height


class PictureError(ValueError):
    """A picture cannot be used; the message states the reason."""


@contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """A picture whose pixels are not read yet.

    Raises:
        PictureError: it is not a picture, damaged, or too large; also where its pixels turn out so within the block.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            picture = Image.open(path, formats=_FORMATS)
    except Image.DecompressionBombError as error:
        raise PictureError(
            f"the picture is too large; at most {LARGEST_PX // 10**6} million pixels are read"
        ) from error
    except (OSError, ValueError, SyntaxError) as error:
        raise PictureError("the picture cannot be read") from error
    with picture:
        width, height = picture.size
        if width * height > LARGEST_PX:
            raise PictureError(
                f"the picture has {width} × {height} pixels; at most {LARGEST_PX // 10**6} million are read"
            )
        try:
            yield picture
        except (OSError, SyntaxError, Image.DecompressionBombError) as error:
            raise PictureError("the picture is damaged") from error


def orientation(picture: Image.Image) -> int:
    """EXIF's orientation, 1 where it is as stored, or if its value is invalid.

    Raises:
        PictureError: the picture is damaged.
    """
    try:
        stored = picture.getexif().get(0x0112)
    except (ValueError, struct.error) as error:  # text or EXIF data behind the pixels
        raise PictureError("the picture is damaged") from error
    return stored if isinstance(stored, int) and stored in _ORIENTATIONS else 1


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture as viewers show it: turned by EXIF's orientation, as labelling tools do.

    Raises:
        PictureError: it is not a picture, or too large.
    """
    with opened(path) as picture:
        width, height = picture.size
        return (height, width) if orientation(picture) in _TURNED else (width, height)


def as_rgb(picture: Image.Image) -> Image.Image:
    """A picture with 8 bits of red, green and blue. Greys of more bits than 8 lose their lowest: as many bits are
    counted as the brightest pixel needs, since cameras of 10 or 12 bits store them in 16.

    Raises:
        PictureError: its pixels are not whole numbers, or some are negative.
    """
    if picture.mode == "F":
        raise PictureError("the picture's pixels are not whole numbers; store it with 8 or 16 bits")
    if picture.mode != "I" and not picture.mode.startswith("I;"):
        return picture.convert("RGB")
    values = np.asarray(picture)
    if values.min() < 0:
        raise PictureError("the picture has pixels below 0")
    bits = max(8, int(values.max()).bit_length())
    return Image.fromarray((values >> (bits - 8)).astype(np.uint8)).convert("RGB")


class PictureIndex:
    """The pictures below a folder, found by the path of a label file."""

    def __init__(self, folder: Path, ending: str = "") -> None:
        """Args:
        ending: of the names of pictures before their suffix, such as `_RAW`; others are not pictures of the dataset.
        """
        self._by_place: dict[tuple[str, str], list[str]] = defaultdict(list)
        self._by_stem: dict[str, list[str]] = defaultdict(list)
        self.unused: dict[str, None] = {}
        """Images not requested yet, in order."""
        for name in files_in(folder, PICTURE_SUFFIXES):
            path = PurePosixPath(name)
            if not path.stem.endswith(ending):
                continue
            stem = _key(path.stem.removesuffix(ending))
            self._by_place[_place(path), stem].append(name)
            self._by_stem[stem].append(name)
            self.unused[name] = None

    def find(self, labels: str, stem: str) -> list[str]:
        """The pictures that labels may belong to: in the same folder or its sibling, else anywhere if there is
        one of that name only. None or several mean that it is not known."""
        key = _key(stem)
        found = self._by_place.get((_place(PurePosixPath(labels)), key)) or self._by_stem.get(key, [])
        for each in found:
            self.unused.pop(each, None)
        return found


def _key(stem: str) -> str:
    """Key of a picture's name, the same for upper and lower case and for either encoding of accents."""
    return normalize("NFC", stem).lower()


def _place(path: PurePosixPath) -> str:
    return "/".join(part for part in path.parent.parts if part.casefold() not in _CONTAINERS)


def files_in(
    folder: Path, suffixes: frozenset[str], on_closed: Callable[[str, bool], None] = lambda _place, _is_link: None
) -> list[str]:
    """The files below a folder with these suffixes, as paths with slashes, sorted; hidden ones are left out.

    Args:
        on_closed: called with each skipped folder, and whether it is a link.
    """
    found = []

    def skipped(error: OSError) -> None:
        on_closed(Path(os.fsdecode(error.filename)).relative_to(folder).as_posix(), False)

    for place, inner, files in os.walk(folder, onerror=skipped):
        inner[:] = [name for name in inner if not name.startswith(".")]
        for name in inner:
            if (Path(place) / name).is_symlink():
                on_closed((Path(place) / name).relative_to(folder).as_posix(), True)
        for name in files:
            path = Path(place) / name
            if path.suffix.lower() in suffixes and not name.startswith(".") and path.is_file():
                found.append(path.relative_to(folder).as_posix())
    return sorted(found)


def inside(folder: Path, name: str) -> Path | None:
    """The file of a name that a label file gives, or None where it leads out of the folder, by `..` or by a link, or
    is not a file name."""
    try:
        path = (folder / name.replace("\\", "/")).resolve()
    except ValueError:  # a zero byte
        return None
    return path if path.is_relative_to(folder.resolve()) else None


def is_file(path: Path) -> bool:
    """Return whether a file exists; False if the path is longer than the system allows."""
    try:
        return path.is_file()
    except OSError:
        return False
