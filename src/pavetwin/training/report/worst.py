"""Images of the worst errors: the most confident wrong detections and the largest missed objects."""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Final

from PIL import Image, ImageDraw

from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, draw_box
from pavetwin.labels.boxes import FloatBox, area, within
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.labels.classes import colours
from pavetwin.reports import canvas
from pavetwin.reports.blocks import ReportFigure
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.evaluate import DetectorEvaluation
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledRegion
from pavetwin.training.evaluation.matching import HALF
from pavetwin.training.evaluation.scores import overlap

SHOWN: Final = 9  # Maximum images of each kind of error
_AROUND: Final = 2.2  # Side of the picture's part that is shown, in longer sides of the box

_LEAST_PX: Final = 160
_NEAR: Final = 0.1  # Overlap from which an error is attributed to an object


@dataclass(frozen=True, slots=True)
class DetectorError:
    """A wrong detection or a missed object."""

    image: LabelledImage
    box: FloatBox
    heading: str
    about: str


def false_alarms(found: DetectorEvaluation) -> list[DetectorError]:
    """Detections that are wrong, the most confident first."""
    places = {image.number: image for image in found.split.images}
    wrong: list[FoundBox] = []
    for each in found.five.classes:
        used = (each.confidence >= found.at_stated.confidence) & ~each.hit[HALF] & ~each.left_out[HALF]
        wrong += [found.five.found[at] for at in each.found[used].tolist()]
    wrong.sort(key=lambda box: -box.confidence)
    return [
        DetectorError(
            places[box.image],
            box.box,
            f"{CLASS_LABELS[box.number_of_class]} {box.confidence:.2f}",
            _reason(box, places[box.image]),
        )
        for box in wrong
    ]


def _reason(box: FoundBox, image: LabelledImage) -> str:
    """Reason for a wrong detection: the object at its place."""
    near = [(overlap(box.box, region.true.box), region) for region in image.regions if not region.true.is_ignored]
    share, region = max(near, key=lambda pair: pair[0], default=(0.0, None))
    if region is None or share < _NEAR:
        return "nothing is there"
    if region.number_of_class != box.number_of_class:
        return f"is a {region.true.category}, IoU {share:.2f}"
    return f"found already, IoU {share:.2f}" if share >= 0.5 else f"box does not fit, IoU {share:.2f}"


def missed(found: DetectorEvaluation) -> list[DetectorError]:
    """Objects that no detection of their class was matched to: the largest of each class, then the next largest."""
    regions = {region.number: (image, region) for image in found.split.images for region in image.regions}
    every: list[tuple[int, LabelledImage, LabelledRegion]] = []
    for each in found.five.classes:
        lost = ~(each.true_confidence >= found.at_stated.confidence)
        mine = [regions[number] for number in each.true_number[lost].tolist()]
        mine.sort(key=lambda pair: -area(pair[1].true.box))
        every += [(rank, *pair) for rank, pair in enumerate(mine)]
    every.sort(key=lambda row: row[0])
    return [
        DetectorError(image, region.true.box, f"{region.true.category} missed", _facts(region))
        for _, image, region in every
    ]


def _facts(region: LabelledRegion) -> str:
    left, top, right, bottom = region.true.box
    parts = [f"{right - left:.0f} × {bottom - top:.0f} px"]
    if (share := region.facts.get("visible_fraction", 1.0)) < 1.0:
        parts.append(f"{100 * share:.0f} % visible")
    if (contrast := region.facts.get("contrast")) is not None:
        parts.append(f"contrast {contrast:.0f}")
    return ", ".join(parts)


def sheet(found: DetectorEvaluation, errors: list[DetectorError], title: str, caption: str) -> ReportFigure | None:
    """A picture of the first errors; None where there is none.

    Raises:
        PaveTwinError: a picture of the dataset cannot be read.
    """
    if not errors:
        return None
    cells = list(_cells(found, errors[:SHOWN]))
    drawn = assembled(
        cells, f"{title}   {len(cells)} of {len(errors)}", colours(CLASS_LABELS), ignored="ignored region"
    )
    stream = BytesIO()
    drawn.save(stream, format="JPEG", quality=82)
    width = round(canvas.WIDTH_IN * 96)
    return ReportFigure(caption, title, stream.getvalue(), "jpeg", width, round(width * drawn.height / drawn.width))


def _cells(found: DetectorEvaluation, errors: list[DetectorError]) -> Iterator[Image.Image]:
    reported: dict[int, list[FoundBox]] = {}
    for box in found.five.found:
        if box.confidence >= found.at_stated.confidence:
            reported.setdefault(box.image, []).append(box)
    for each in errors:
        yield _cell(found, each, reported.get(each.image.number, []))


def _cell(found: DetectorEvaluation, error: DetectorError, reported: list[FoundBox]) -> Image.Image:
    picture = found.split.data.picture(error.image.example)
    left, top, right, bottom = error.box
    side = min(max(_AROUND * max(right - left, bottom - top), _LEAST_PX), float(max(picture.size)))
    x = min(max((left + right - side) / 2, 0.0), max(picture.width - side, 0.0))
    y = min(max((top + bottom - side) / 2, 0.0), max(picture.height - side, 0.0))
    window = (round(x), round(y), round(x + side), round(y + side))
    scale = CELL_PX / (window[2] - window[0])
    shown = picture.crop(window).resize((CELL_PX, CELL_PX), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(shown)
    colour = colours(CLASS_LABELS)

    def on_cell(box: FloatBox) -> FloatBox:
        return (
            (box[0] - window[0]) * scale,
            (box[1] - window[1]) * scale,
            (box[2] - window[0]) * scale,
            (box[3] - window[1]) * scale,
        )

    for region in error.image.regions:
        number = region.number_of_class
        if region.true.is_ignored or number is None:
            draw_box(pen, on_cell(region.true.box), None)
        elif within(region.true.box, error.box):
            draw_box(pen, on_cell(region.true.box), colour[CLASS_LABELS[number]])
    for box in reported:
        if within(box.box, error.box):
            _corners(pen, on_cell(box.box), colour[CLASS_LABELS[box.number_of_class]])
    name = error.image.example.name
    short = name if len(name) <= 22 else f"…{name[-21:]}"
    return captioned(shown, error.heading, f"{error.about}  ·  {short}", "")


def _corners(pen: ImageDraw.ImageDraw, box: FloatBox, colour: str) -> None:
    """A detection: thick corners, so that the box of the object under it is still seen."""
    left, top, right, bottom = box
    arm = min(max(0.28 * min(right - left, bottom - top), 6.0), 40.0)
    for x, inward in ((left, arm), (right, -arm)):
        for y, down in ((top, arm), (bottom, -arm)):
            for ink, width in (("#101010", 9), (colour, 5)):
                pen.line([(x + inward, y), (x, y), (x, y + down)], fill=ink, width=width, joint="curve")
