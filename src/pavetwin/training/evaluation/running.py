"""What a model says of a dataset's images, with the sizes of defects where an image's ground resolution is known."""

from collections.abc import Callable, Iterable, Sequence
from io import BytesIO
from typing import Final, Protocol

from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox
from pavetwin.perception.classes import coarse_of_classes
from pavetwin.perception.inference.detections import Detections
from pavetwin.perception.inference.pictures import Picture
from pavetwin.perception.results.detected_image import sizes_of
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledSplit

LEAST_CONFIDENCE: Final = 0.001
"""Of the detector of an evaluation: average precision reads the whole curve."""


class Detects(Protocol):
    """What finds things in pictures."""

    def detect(self, images: Iterable[Picture]) -> list[Detections]:
        """The detections of each image."""


def found_by(
    detector: Detects, splits: Sequence[LabelledSplit], tell: Callable[[float], None] | None = None
) -> tuple[FoundBox, ...]:
    """The detections in all images of some splits of a dataset.

    Raises:
        PaveTwinError: a picture is missing, or no image.
    """
    images = [(split, image) for split in splits for image in split.images]
    found: list[FoundBox] = []
    for at, (split, image) in enumerate(images):
        found += _found(detector, split, image)
        if tell is not None:
            tell((at + 1) / len(images))
    return tuple(found)


class AsksRegions(Protocol):
    """What says the subtype of given regions."""

    def subtypes_at(self, image: Picture, boxes: Sequence[FloatBox]) -> list[int]:
        """The number in `SUBTYPES` of each region of an image."""


def subtypes_by(detector: AsksRegions, split: LabelledSplit) -> dict[int, int]:
    """What the subtype head says at the true boxes of defects: number of the annotation → number in `SUBTYPES`.

    Raises:
        PaveTwinError: a picture is missing, or no image.
    """
    told: dict[int, int] = {}
    for image in split.images:
        regions = [each for each in image.regions if each.has_subtype]
        if regions:
            said = detector.subtypes_at(_picture(split, image), [each.true.box for each in regions])
            told |= zip((each.number for each in regions), said, strict=True)
    return told


def _picture(split: LabelledSplit, image: LabelledImage) -> Image.Image:
    try:
        picture = Image.open(BytesIO(split.data.encoded(image.example)))
        picture.load()
    except OSError as error:
        raise PaveTwinError(f"The picture of '{image.example.name}' cannot be read as an image ({error}).") from error
    return picture


def _found(detector: Detects, split: LabelledSplit, image: LabelledImage) -> list[FoundBox]:
    (said,) = detector.detect([_picture(split, image)])
    gsd_mm = image.facts.get("gsd_mm", image.example.gsd_mm)
    coarse = coarse_of_classes(said.classes)
    rows = []
    for at in range(len(said)):
        told = sizes_of(said, at, gsd_mm) if gsd_mm else {}
        number, severity = int(said.classes[at]), str(told.get("severity", ""))
        sizes = {name: value for name, value in told.items() if not isinstance(value, str) and value > 0}
        detection = float(said.detection[at])
        confidence = detection * float(said.subtype[at])
        rows.append(
            FoundBox(image.number, int(coarse[at]), number, said.box(at), detection, confidence, sizes, severity)
        )
    return rows
