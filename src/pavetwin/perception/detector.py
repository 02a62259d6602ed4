"""A detector that is ready for use: `Detector("model.onnx").detect(["street.jpg"])`."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from pavetwin.arrays import Float32Array, UInt8Array
from pavetwin.detections import Detections, MaskPart
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.class_names import CLASSES, SUBTYPES
from pavetwin.perception.images import ImageLike, pixels_of
from pavetwin.perception.model_file import ModelFacts, model_path, open_session
from pavetwin.perception.suppression import lowering, whole_objects
from pavetwin.perception.tiles import merged, tile_windows

GREY: Final = 114
"""Padding right of and below an image whose sides are not multiples of the stride, as in training."""

BATCH: Final = 4
"""Tiles that run together."""

WHOLE: Final = 1.6
"""Multiple of the training image's side up to which an image is searched as a whole and not in tiles. Training covers
such scales, and a crack that is seen whole is found more often than its parts; see docs/how-to/detect.md."""

MOST: Final = 300
"""Most detections of an image or a tile; the most confident are kept."""


class Detector:
    """An open model file. It is safe to use from several threads."""

    def __init__(
        self,
        path: str | Path,
        *,
        confidence: float = 0.25,
        overlap: float = 0.7,
        tiled: bool | None = None,
        overview: bool = False,
        image_px: int = 0,
        threads: int = 0,
    ) -> None:
        """Args:
            path: ONNX file of `pavetwin export`, or the name of a model that ships.
            confidence: least final confidence of a detection.
            overlap: IoU from which the less confident of two boxes of a coarse class is dropped.
            tiled: search images larger than `image_px` in tiles at their own resolution, instead of scaling them to
                `image_px`; None follows the model's training, with tiles from `WHOLE` times `image_px`.
            overview: search images larger than `image_px` both in tiles and as a whole, and merge the detections: the
                whole shows large objects, the tiles small ones. `WHOLE` does not apply.
            image_px: longer side of the network's input; 0 for that of its training.
            threads: threads per image; 0 for one per core.

        Raises:
            PaveTwinError: the file is not there, damaged, or another model, or a value is out of its bounds.
        """
        for name, value in (("confidence", confidence), ("overlap", overlap)):
            if not 0.0 < value < 1.0:
                raise PaveTwinError(f"`{name}` {value:g}: it must be above 0 and below 1.")
        if overview and tiled is False:
            raise PaveTwinError("`overview` adds to the search in tiles, which `tiled` turns off.")
        self.facts = self._open(Path(path), threads)
        self.image_px = image_px or self.facts.image_px
        if not 64 <= self.image_px <= 4096 or self.image_px % self.facts.stride:
            raise PaveTwinError(f"`image_px` {self.image_px}: a multiple of {self.facts.stride} from 64 to 4096.")
        self.overview = overview
        self.tiled = overview or (self.facts.native if tiled is None else tiled)
        self._whole_px = self.image_px * (WHOLE if tiled is None and not overview else 1.0)
        self._confidence, self._overlap = confidence, overlap

    def _open(self, path: Path, threads: int) -> ModelFacts:
        self._session, facts = open_session(model_path(path), threads)
        return facts

    @property
    def gives_masks(self) -> bool:
        """Whether its detections of defects have masks, from which they are measured."""
        return self.facts.mask_px > 0

    def detect(self, images: Iterable[ImageLike], report: Callable[[float], None] | None = None) -> list[Detections]:
        """The detections of each image.

        Args:
            report: called before each image and every few tiles with the share of the image that is done; an exception
                from it ends the work.

        Raises:
            PaveTwinError: a file cannot be read as an image.
        """
        return list(self.each(images, report))

    def each(self, images: Iterable[ImageLike], report: Callable[[float], None] | None = None) -> Iterator[Detections]:
        """`detect` as an iterator, for more images than fit into memory."""
        return (self._of_image(pixels_of(image), report or (lambda _: None)) for image in images)

    def in_tiles(self, size: tuple[int, int]) -> bool:
        """Whether an image of this width and height is searched in tiles."""
        return self.tiled and max(size) > self._whole_px

    def _of_image(self, pixels: UInt8Array, report: Callable[[float], None]) -> Detections:
        report(0.0)
        size = (pixels.shape[1], pixels.shape[0])
        if not self.in_tiles(size):
            return self._whole(pixels)
        tiles = tile_windows(size, self.image_px)
        found: list[Detections] = []
        for start in range(0, len(tiles), BATCH):
            report(start / len(tiles))
            found += self._tiles(pixels, tiles[start : start + BATCH])
        if self.overview:
            report(1.0)
            tiles.append((0, 0, *size))
            found.append(self._whole(pixels))
        return merged(found, tiles)

    def _whole(self, pixels: UInt8Array) -> Detections:
        """Detections in the image scaled to `image_px`."""
        height, width = pixels.shape[:2]
        shown = self._fitted(pixels)
        step = np.array([width / shown.shape[1], height / shown.shape[0]] * 2, dtype=np.float32)
        (found,) = self._run([shown])
        return _detections((width, height), found, step, (0, 0))

    def _fitted(self, pixels: UInt8Array) -> UInt8Array:
        height, width = pixels.shape[:2]
        scale = self.image_px / max(width, height)
        small = (max(1, round(scale * width)), max(1, round(scale * height)))
        return pixels if small == (width, height) else _resized(pixels, small)

    def _tiles(self, pixels: UInt8Array, tiles: Sequence[PixelBox]) -> Iterator[Detections]:
        size = (pixels.shape[1], pixels.shape[0])
        shown = [pixels[top:bottom, left:right] for left, top, right, bottom in tiles]
        for tile, found in zip(tiles, self._run(shown), strict=True):
            yield _detections(size, found, np.ones(4, dtype=np.float32), tile[:2])

    def _run(self, shown: Sequence[UInt8Array]) -> list[dict[str, Any]]:
        """Detections of the model in images of one size, in their pixels."""
        height, width = shown[0].shape[:2]
        outputs = self._outputs(self._canvas(shown))
        outputs["boxes"] = np.minimum(outputs["boxes"], np.array([width, height] * 2, dtype=np.float32))
        final = outputs["detection"] * outputs["subtype"]
        rows = []
        for at in range(len(shown)):
            sides = outputs["boxes"][:, 2:] - outputs["boxes"][:, :2]
            mine = np.flatnonzero((outputs["image"] == at) & (final >= self._confidence) & (sides > 0).all(axis=1))
            best = mine[np.argsort(-final[mine], kind="stable")]
            grids = outputs["masks"][best] if "masks" in outputs else None
            best = best[whole_objects(outputs["boxes"][best], outputs["classes"][best], grids)]
            factors = lowering(outputs["boxes"][best], outputs["classes"][best]).astype(np.float32)
            outputs["detection"][best] *= factors
            final[best] *= factors
            best = best[final[best] >= self._confidence]
            best = best[np.argsort(-final[best], kind="stable")][:MOST]
            rows.append({name: values[best] for name, values in outputs.items()})
        return rows

    def _canvas(self, shown: Sequence[UInt8Array]) -> UInt8Array:
        """(images, rows, columns, 3) Images of one size, padded to multiples of the stride."""
        height, width = shown[0].shape[:2]
        step = self.facts.stride
        canvas = np.full((len(shown), -(-height // step) * step, -(-width // step) * step, 3), GREY, dtype=np.uint8)
        for at, each in enumerate(shown):
            canvas[at, :height, :width] = each
        return canvas

    def _outputs(self, canvas: UInt8Array) -> dict[str, Any]:
        """The model's outputs by name."""
        limits = {"confidence": self._confidence, "overlap": self._overlap}
        given = {name: np.array([limit], dtype=np.float32) for name, limit in limits.items()}
        names = [each.name for each in self._session.get_outputs()]
        return dict(zip(names, self._session.run(names, {"images": canvas, **given}), strict=True))


def _detections(
    size_px: tuple[int, int], found: dict[str, Any], step: Float32Array, corner: tuple[int, int]
) -> Detections:
    """The outputs for a part of an image as detections in the image's pixels: scaled by `step`, moved to `corner`."""
    limits = np.array([*size_px, *size_px], dtype=np.float32)
    boxes = np.clip(found["boxes"] * step + np.array([*corner, *corner], dtype=np.float32), 0, limits)
    names = [CLASSES[number] for number in found["classes"]]
    grids = found.get("masks")
    masks: list[tuple[MaskPart, ...]] = []
    for row, (left, top, right, bottom) in enumerate(boxes.tolist()):
        has_mask = grids is not None and names[row] in SUBTYPES
        masks.append((MaskPart((left, top, right, bottom), grids[row]),) if has_mask else ())  # type: ignore[index]
    return Detections(
        names,
        found["detection"] * found["subtype"],
        size_px=size_px,
        box_px=boxes,
        mask=masks,
        detection_confidence=found["detection"],
        subtype_confidence=found["subtype"],
    )


def _resized(pixels: UInt8Array, size: tuple[int, int]) -> UInt8Array:
    """Resize by the filter that training uses."""
    return np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.BILINEAR, reducing_gap=3.0))
