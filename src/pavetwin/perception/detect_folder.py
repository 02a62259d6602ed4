"""Detect in a source and write the results: annotated images, and files for other programs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.perception.detector import Detector
from pavetwin.perception.images import SourceImage, source_images
from pavetwin.perception.measuring import check_size
from pavetwin.perception.results import DetectedImage, annotated, coco, described, geojson, label_studio, table

PICTURES_FOLDER: Final = "pictures"
COCO_FILE: Final = "coco.json"
LABEL_STUDIO_FILE: Final = "label-studio.json"
TABLE_FILE: Final = "detections.csv"
GEOJSON_FILE: Final = "detections.geojson"

_QUALITY: Final = 90


@dataclass(frozen=True, slots=True)
class DetectOutcome:
    """Results of detecting in a source."""

    images: tuple[DetectedImage, ...]
    unreadable: tuple[str, ...]
    """Messages on files of a folder that are not readable as images."""
    files: tuple[Path, ...]
    """Written files, without the annotated images."""


def detect_source(
    detector: Detector,
    source: Path,
    output: Path,
    *,
    every_s: float = 1.0,
    gsd_mm: float | None = None,
    pictures: bool = True,
    report: Callable[[float, str], None] = lambda share, what: None,  # noqa: ARG005
) -> DetectOutcome:
    """Detect in every image of a source. Memory holds one image at a time, and all detections.

    Args:
        output: folder of the files; it may exist.
        every_s: seconds between the frames of a video.
        gsd_mm: ground resolution of all images, which takes precedence over the poses of photographs.
        pictures: write annotated images too.
        report: called with the share done and a message.

    Raises:
        PaveTwinError: the source holds no readable image, a value is out of its bounds, or a file cannot be written.
    """
    if gsd_mm is not None:
        check_size("gsd_mm", gsd_mm)
    done: list[DetectedImage] = []
    unreadable: list[str] = []
    for image in source_images(source, every_s, output):
        message = f"Detecting in image {len(done) + 1}"
        report(image.share, message)
        try:
            pixels, pose = image.read()
        except PaveTwinError as error:
            if not source.is_dir():
                raise
            unreadable.append(str(error))
            continue
        (found,) = detector.detect([pixels], partial(_report, image, message, report))
        done.append(described(image.name, found, pose, gsd_mm))
        if pictures:
            name = PurePosixPath(image.name)
            # The suffix is part of the name, since a.jpg and a.png are two images.
            target = output / PICTURES_FOLDER / name.with_name(f"{name.stem}-{name.suffix[1:]}.jpg")
            with writing(target) as temporary:
                annotated(pixels, done[-1]).save(temporary, "JPEG", quality=_QUALITY)
    if not done:
        raise PaveTwinError(unreadable[0] if unreadable else f"'{source}' has no frame that can be read.")
    return DetectOutcome(tuple(done), tuple(unreadable), _write(done, output))


def _report(image: SourceImage, message: str, report: Callable[[float, str], None], done: float) -> None:
    """Args:
    done: share of the image.
    """
    report(image.share + done * image.part, message)


def _write(images: list[DetectedImage], output: Path) -> tuple[Path, ...]:
    contents = {COCO_FILE: coco(images), LABEL_STUDIO_FILE: label_studio(images), TABLE_FILE: table(images)}
    if (places := geojson(images)) is not None:
        contents[GEOJSON_FILE] = places
    for name, text in contents.items():
        with writing(output / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return tuple(output / name for name in contents)
