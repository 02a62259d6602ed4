"""Detections of an image as files and replies: annotated images, COCO, Label Studio, a table, GeoJSON and JSON."""

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pavetwin.arrays import UInt8Array
from pavetwin.detections import SIZES, Detections
from pavetwin.labels.boxes import FloatBox, corners
from pavetwin.labels.class_names import CLASSES, display_name
from pavetwin.labels.coco import annotation_row, coco_file, image_row, rings
from pavetwin.labels.outlines import outline
from pavetwin.perception.drone_tags import LonLat
from pavetwin.perception.measuring import stated_sizes, with_sizes
from pavetwin.perception.photograph import PhotographPose

MEASURED: Final = (*SIZES, "severity")
"""Columns of measured values, in the order of the table."""

COLUMNS: Final = (
    *("image", "class", "confidence", "det_conf", "cls_conf", "left", "top", "right", "bottom"),
    *(*MEASURED, "longitude", "latitude"),
)
"""Columns of the table."""

_COLOURS: Final = dict(
    zip(CLASSES, [(255, 176, 0), (254, 97, 0), (220, 38, 127), (0, 158, 115), (100, 143, 255)], strict=True)
)
"""Colours that stay distinct in colour-blindness (after Wong 2011 and IBM's palette)."""

_FILL: Final = 90
"""Opacity of masks, of 255."""


@dataclass(frozen=True, slots=True)
class DetectedImage:
    """An image with its detections, the most confident first."""

    name: str
    """Path of its file below the source folder; for a video, with the frame's number."""
    size_px: tuple[int, int]
    detections: Detections
    """With outlines and sizes, without masks."""
    pose: PhotographPose
    gsd_mm: float | None = None
    """Ground resolution in the middle of the image."""

    @property
    def lonlat(self) -> LonLat | None:
        """Position of the camera."""
        return self.pose.lonlat

    def box(self, row: int) -> FloatBox:
        """Box of a detection, to a hundredth of a pixel."""
        left, top, right, bottom = self.detections.box(row)
        return round(left, 2), round(top, 2), round(right, 2), round(bottom, 2)

    def ground(self, row: int) -> list[LonLat] | None:
        """Corners of the box on the ground, from the upper left one clockwise in the image; None without a pose."""
        return self.pose.lonlats(corners(self.detections.box(row)))

    def confidences(self, row: int) -> tuple[float, float, float]:
        """Final confidence, that in the coarse class, and that in the subtype."""
        coarse = float(self.detections.detection_confidence[row])
        subtype = float(self.detections.subtype_confidence[row])
        return coarse * subtype, coarse, subtype

    def attributes(self, row: int) -> dict[str, Any]:
        """Both partial confidences and the sizes, for files."""
        _, coarse, subtype = self.confidences(row)
        return {
            "det_conf": round(coarse, 4),
            "cls_conf": round(subtype, 4),
            **stated_sizes(self.detections, row),
        }


def described(
    name: str, found: Detections, pose: PhotographPose | None = None, gsd_mm: float | None = None
) -> DetectedImage:
    """An image with outlines of its detections, and the sizes that its pose allows.

    Args:
        found: the detections of one image, with their masks.
        gsd_mm: ground resolution of the whole image, which takes precedence over the pose.
    """
    assert found.size_px is not None
    pose = pose or PhotographPose(found.size_px)
    middles = ((found.box_px[:, :2] + found.box_px[:, 2:]) / 2).tolist()
    scales = [gsd_mm or pose.gsd_mm(x, y) or nan for x, y in middles]
    middle = gsd_mm or pose.gsd_mm(found.size_px[0] / 2, found.size_px[1] / 2)
    detections = _outlined(with_sizes(found, scales)).without("mask")
    return DetectedImage(name, found.size_px, detections, pose, round(middle, 3) if middle else None)


def _outlined(found: Detections) -> Detections:
    """Detections with `outline_px` and `area_px`."""
    outlines: list[list[tuple[float, float]] | None] = []
    areas = []
    for row, (left, top, right, bottom) in enumerate(found.box_px.tolist()):
        mask = found.mask_pixels(row)
        if mask is None or not mask[1].any():
            outlines.append(None)
            areas.append((right - left) * (bottom - top))
            continue
        (x, y, _, _), covered = mask
        outlines.append([(round(float(px) + x, 1), round(float(py) + y, 1)) for px, py in outline(covered)])
        areas.append(float(np.count_nonzero(covered)))
    return found.with_columns(outline_px=outlines, area_px=areas)


def annotated(pixels: UInt8Array, image: DetectedImage) -> Image.Image:
    """An image (rows, columns, 3) with masks, boxes, classes and confidences; the most confident on top."""
    drawn = Image.fromarray(np.ascontiguousarray(pixels))
    height = max(11, round(max(drawn.size) / 70))
    font, line = ImageFont.load_default(height), max(2, round(max(drawn.size) / 400))
    pen = ImageDraw.Draw(drawn, "RGBA")
    names, outlines = image.detections.class_name, image.detections.outline_px
    for row in reversed(range(len(names))):
        if outlines[row] and len(outlines[row]) > 2:
            pen.polygon([(x + 0.5, y + 0.5) for x, y in outlines[row]], fill=(*_COLOURS[names[row]], _FILL))
        pen.rectangle(image.box(row), outline=_COLOURS[names[row]], width=line)
    for row in reversed(range(len(names))):
        text = f"{display_name(names[row])} {image.confidences(row)[0]:.2f}"
        _label(pen, text, image.box(row), drawn.size, font, _COLOURS[names[row]])
    return drawn


def _label(
    pen: ImageDraw.ImageDraw,
    text: str,
    box: tuple[float, float, float, float],
    size: tuple[int, int],
    font: ImageFont.ImageFont | ImageFont.FreeTypeFont,
    colour: tuple[int, int, int],
) -> None:
    """Draw a label above the box, or within it where there is no room; never beyond the image's right edge."""
    left, top, right, bottom = pen.textbbox((0, 0), text, font=font)
    width, height = right - left + 4, bottom - top + 4
    x = max(0.0, min(box[0], size[0] - width))
    y = box[1] - height if box[1] >= height else box[1]
    pen.rectangle((x, y, x + width, y + height), fill=colour)
    dark = sum(colour) > 380
    pen.text((x + 2 - left, y + 2 - top), text, font=font, fill=(0, 0, 0) if dark else (255, 255, 255))


def coco(images: Sequence[DetectedImage]) -> str:
    """Annotations in COCO's format. CVAT reads `attributes`; masks are polygons."""
    numbered = list(enumerate(images, start=1))
    places = [(number, image, row) for number, image in numbered for row in _rows(image)]
    rows = (
        image_row(number, image.name, image.size_px, **({"gsd_mm": image.gsd_mm} if image.gsd_mm else {}))
        for number, image in numbered
    )
    annotations = (_annotation(at, *place) for at, place in enumerate(places, start=1))
    return b"".join(coco_file("Detections by PaveTwin", rows, annotations)).decode()


def _annotation(number: int, image_number: int, image: DetectedImage, row: int) -> dict[str, Any]:
    found = image.detections
    return annotation_row(
        number,
        image_number,
        CLASSES.index(found.class_name[row]),
        image.box(row),
        area_px=round(float(found.area_px[row]), 1),
        segmentation=rings(found.outline_px[row]) if found.outline_px[row] else [],
        score=round(image.confidences(row)[0], 4),
        attributes=image.attributes(row),
    )


def label_studio(images: Sequence[DetectedImage]) -> str:
    """Tasks with predictions: `rectanglelabels` of a control `label` for an `Image` named `image`."""
    return _json(
        [
            {
                "data": {"image": image.name},
                "predictions": [
                    {
                        "model_version": "pavetwin",
                        "score": round(max((image.confidences(row)[0] for row in _rows(image)), default=0.0), 4),
                        "result": [_region(image, row) for row in _rows(image)],
                    }
                ],
            }
            for image in images
        ]
    )


def _region(image: DetectedImage, row: int) -> dict[str, Any]:
    left, top, right, bottom = image.box(row)
    width, height = image.size_px
    across, down = 100 / width, 100 / height
    return {
        "id": f"r{row + 1}",
        "type": "rectanglelabels",
        "from_name": "label",
        "to_name": "image",
        "original_width": width,
        "original_height": height,
        "image_rotation": 0,
        "score": round(image.confidences(row)[0], 4),
        "value": {
            "x": round(left * across, 4),
            "y": round(top * down, 4),
            "width": round((right - left) * across, 4),
            "height": round((bottom - top) * down, 4),
            "rotation": 0,
            "rectanglelabels": [display_name(image.detections.class_name[row])],
        },
        "meta": {"text": [f"{name} {value}" for name, value in image.attributes(row).items()]},
    }


def table(images: Sequence[DetectedImage]) -> str:
    """A row for each detection; unknown sizes and places are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for image in images:
        for row in _rows(image):
            ground, sizes = image.ground(row), stated_sizes(image.detections, row)
            name = display_name(image.detections.class_name[row])
            confidences = (f"{each:.4f}" for each in image.confidences(row))
            measures = (sizes.get(column, "") for column in MEASURED)
            place = _middle(ground) if ground else ("", "")
            writer.writerow([image.name, name, *confidences, *image.box(row), *measures, *place])
    return text.getvalue()


def geojson(images: Sequence[DetectedImage]) -> str | None:
    """A feature for each detection of a photograph with a position; None where no photograph has one.

    The geometry is the box's outline on the ground where the direction of view is known, or else the camera's own
    place: the property `place` states which.
    """
    features = []
    for image in images:
        for row in _rows(image):
            ground = image.ground(row)
            if ground is None and image.lonlat is None:
                continue
            properties = {
                "image": image.name,
                "class": display_name(image.detections.class_name[row]),
                "confidence": round(image.confidences(row)[0], 4),
                **image.attributes(row),
                "place": "ground" if ground else "camera",
            }
            features.append({"type": "Feature", "geometry": _geometry(ground, image), "properties": properties})
    if not any(image.lonlat for image in images):
        return None
    return _json({"type": "FeatureCollection", "features": features})


def _geometry(ground: Sequence[LonLat] | None, image: DetectedImage) -> dict[str, Any]:
    if ground is None:
        return {"type": "Point", "coordinates": image.lonlat}
    # The right-hand rule of RFC 7946: counter-clockwise on the earth, which clockwise in the image is not.
    ring = [*reversed(ground)]
    return {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}


def _middle(ring: Sequence[LonLat]) -> LonLat:
    count = len(ring)
    return round(sum(place[0] for place in ring) / count, 8), round(sum(place[1] for place in ring) / count, 8)


def _rows(image: DetectedImage) -> range:
    return range(len(image.detections))


def _json(content: Any) -> str:
    return json.dumps(content, ensure_ascii=False, indent=1) + "\n"


def _reply(image: DetectedImage) -> dict[str, Any]:
    found = image.detections
    return {
        "name": image.name,
        "width": image.size_px[0],
        "height": image.size_px[1],
        "detections": [
            {
                "class": display_name(found.class_name[row]),
                "class_id": CLASSES.index(found.class_name[row]),
                "confidence": round(image.confidences(row)[0], 4),
                "det_conf": round(image.confidences(row)[1], 4),
                "cls_conf": round(image.confidences(row)[2], 4),
                "box": list(image.box(row)),
                "outline": [list(corner) for corner in found.outline_px[row] or ()],
                "sizes": stated_sizes(found, row),
                "ground": [list(corner) for corner in image.ground(row) or ()],
            }
            for row in _rows(image)
        ],
    }


def _reply_rdmo(image: DetectedImage) -> list[dict[str, Any]]:
    return [
        {
            "clase": display_name(image.detections.class_name[row]),
            "det_conf": round(image.confidences(row)[1], 4),
            "cls_conf": round(image.confidences(row)[2], 4),
            "caja": list(image.box(row)),
        }
        for row in _rows(image)
    ]


REPLIES: Final[Mapping[str, Callable[[DetectedImage], Any]]] = {"json": _reply, "rdmo": _reply_rdmo}
"""Replies of the server by the name in `?format=`, the default first: PaveTwin's, and that of the paper's public
server."""
