"""Images brought to one size: scaled down, or cut into tiles. Boxes and outlines go with them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from PIL import Image, ImageOps
from pydantic import Field

from pavetwin.config.settings import Settings
from pavetwin.labels.boxes import PixelBox, moved, scaled, share_within, to_pixels, within
from pavetwin.labels.common_form import AnnotatedImage, Annotation, Polygon
from pavetwin.training.datasets.pictures import as_rgb, opened, orientation

LEAST_SHARE: Final = 0.3
"""Least visible share of a box at a tile's border; with less it is ignored, neither an object nor background."""

CUT: Final = "cut"


class ImageSize(Settings):
    """Size of imported images. No image is enlarged: that adds no detail."""

    longest_px: int = Field(default=640, ge=64, le=16384, description="Longer side of images in pixels, at most.")
    tiles: bool = Field(
        default=False, description="Cut larger images into tiles of that size instead of scaling them down."
    )
    tile_overlap: float = Field(default=0.2, ge=0.0, le=0.5, description="Share of a tile that the next one shows too.")
    target_gsd_mm: float | None = Field(
        default=None, gt=0, le=1000, description="Ground resolution that images are scaled to."
    )
    quality: int = Field(default=92, ge=50, le=100, description="JPEG quality.")


@dataclass(frozen=True, slots=True)
class ImageView:
    """A window of a picture, scaled to an image of its own."""

    window: PixelBox
    """In the picture's own pixels."""
    size_px: tuple[int, int]
    """Width, height of the result."""
    number: int | None = None
    """Number of a tile, from 0, row by row; None for the whole picture."""

    @property
    def factors(self) -> tuple[float, float]:
        """Scale factors of width and height."""
        left, top, right, bottom = self.window
        return self.size_px[0] / (right - left), self.size_px[1] / (bottom - top)


def views(image: AnnotatedImage, size: ImageSize) -> list[ImageView]:
    """Views of an image: the whole, scaled down if necessary, or tiles row by row."""
    width, height = image.size_px
    factor = 1.0
    if size.target_gsd_mm is not None and image.gsd_mm is not None:
        factor = min(1.0, image.gsd_mm / size.target_gsd_mm)
    longest = max(width, height) * factor
    if not size.tiles or longest <= size.longest_px:
        return [ImageView((0, 0, width, height), _size(width, height, factor * min(1.0, size.longest_px / longest)))]
    side = min(round(size.longest_px / factor), max(width, height))
    places = [
        (left, top, min(left + side, width), min(top + side, height))
        for top in _starts(height, side, size.tile_overlap)
        for left in _starts(width, side, size.tile_overlap)
    ]
    return [
        ImageView(place, _size(place[2] - place[0], place[3] - place[1], min(factor, size.longest_px / side)), number)
        for number, place in enumerate(places)
    ]


def _size(width: int, height: int, factor: float) -> tuple[int, int]:
    return max(1, round(width * factor)), max(1, round(height * factor))


def _starts(length: int, side: int, overlap: float) -> list[int]:
    """Starts of tiles along one side: evenly spaced, the first and the last at the borders."""
    if length <= side:
        return [0]
    count = int(np.ceil((length - side) / (side * (1 - overlap)))) + 1
    return [int(start) for start in np.linspace(0, length - side, count).round()]


def seen_through(image: AnnotatedImage, view: ImageView, suffix: str) -> AnnotatedImage:
    """The image of a view, with the annotations that it shows; those cut to less than `LEAST_SHARE` are ignored."""
    across, down = view.factors
    annotations = tuple(shown for each in image.annotations if (shown := _seen(each, view, (across, down))) is not None)
    return replace(
        image,
        name=image.name if view.number is None else f"{image.name}-{view.number:03d}",
        suffix=suffix,
        size_px=view.size_px,
        gsd_mm=None if image.gsd_mm is None else round(image.gsd_mm / across, 4),
        annotations=annotations,
    )


def scaled_down(image: AnnotatedImage, factor: float) -> AnnotatedImage:
    """The whole image at a smaller size, with its annotations; itself for a factor of 1."""
    if factor >= 1:
        return image
    return seen_through(image, ImageView((0, 0, *image.size_px), _size(*image.size_px, factor)), image.suffix)


def _seen(annotation: Annotation, view: ImageView, factors: tuple[float, float]) -> Annotation | None:
    inside = within(annotation.box, view.window)
    if inside is None:
        return None
    left, top = view.window[:2]
    box = to_pixels(scaled(moved(inside, -left, -top), *factors), view.size_px)
    if box is None:
        return None
    is_cut = share_within(annotation.box, view.window) < LEAST_SHARE
    return replace(
        annotation,
        box=box,
        ignored=CUT if is_cut and annotation.ignored is None else annotation.ignored,
        outline=_outline(annotation.outline, view, factors),
    )


def _outline(outline: Polygon | None, view: ImageView, factors: tuple[float, float]) -> Polygon | None:
    """The part of an outline in the window, in pixels of the result; of several parts, the largest."""
    if outline is None:
        return None
    left, top, right, bottom = view.window
    shape = shapely.Polygon(outline)
    if not shapely.within(shape, shapely.box(left, top, right, bottom)):
        parts = shapely.get_parts(shapely.make_valid(shape).intersection(shapely.box(left, top, right, bottom)))
        areas = shapely.area(parts)
        if not areas.any():
            return None
        shape = parts[int(areas.argmax())]
    corners = (shapely.get_coordinates(shape.exterior)[:-1] - (left, top)) * factors
    return tuple((round(float(x), 2), round(float(y), 2)) for x, y in corners)


def kept_as_it_is(path: Path, view: ImageView) -> bool:
    """Return whether a picture's file can be copied: neither scaled nor rotated, and in a common format."""
    if view.number is not None or view.factors != (1.0, 1.0) or path.suffix.lower() not in (".jpg", ".jpeg", ".png"):
        return False
    with opened(path) as picture:
        return picture.mode in ("RGB", "L") and orientation(picture) == 1 and picture.format in ("JPEG", "PNG")


def encoded_views(path: Path, image_views: list[ImageView], quality: int) -> Iterator[bytes]:
    """The views of a picture as JPEG, one at a time; a picture that is kept as it is, is only checked and copied.

    Args:
        image_views: the whole picture alone, or tiles.

    Raises:
        PictureError: it is damaged.
    """
    is_whole = image_views[0].number is None
    if is_whole and kept_as_it_is(path, image_views[0]):
        content = path.read_bytes()
        with opened(path) as picture:
            picture.load()
        yield content
        return
    with opened(path) as picture:
        if is_whole and orientation(picture) == 1:  # a JPEG is decoded at a half, a quarter or an eighth, not below
            picture.draft("RGB", image_views[0].size_px)
        turned = as_rgb(ImageOps.exif_transpose(picture))
    for view in image_views:
        part = turned if is_whole else turned.crop(view.window)
        if part.size != view.size_px:
            part = part.resize(view.size_px, Image.Resampling.LANCZOS, reducing_gap=3.0)
        held = BytesIO()
        part.save(held, "JPEG", quality=quality, subsampling=0)
        yield held.getvalue()
