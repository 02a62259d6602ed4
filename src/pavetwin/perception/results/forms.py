"""Files of detections for other programs: COCO (CVAT), Label Studio, a table, and GeoJSON."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any, Final

from pavetwin.labels.coco import annotation_row, coco_file, image_row, rings
from pavetwin.perception.classes import SIZES
from pavetwin.perception.results.detected_image import DetectedImage, DetectedThing
from pavetwin.perception.results.photograph import LonLat

MEASURED: Final = (*SIZES, "severity")
"""Columns of what is measured, in the order of the table."""

COLUMNS: Final = (
    *("image", "class", "confidence", "det_conf", "cls_conf", "left", "top", "right", "bottom"),
    *(*MEASURED, "longitude", "latitude"),
)
"""Of the table."""


def coco(images: Sequence[DetectedImage]) -> str:
    """COCO's annotations. CVAT reads `attributes`; masks are polygons."""
    numbered = list(enumerate(images, start=1))
    things = [(number, thing) for number, image in numbered for thing in image.things]
    rows = (
        image_row(number, image.name, image.size_px, **({"gsd_mm": image.gsd_mm} if image.gsd_mm else {}))
        for number, image in numbered
    )
    annotations = (
        annotation_row(
            at,
            number,
            thing.number,
            thing.box,
            area_px=round(thing.area_px, 1),
            segmentation=rings(thing.outline) if thing.outline else [],
            score=round(thing.confidence, 4),
            attributes=thing.attributes,
        )
        for at, (number, thing) in enumerate(things, start=1)
    )
    return b"".join(coco_file("Detections by PaveTwin", rows, annotations)).decode()


def label_studio(images: Sequence[DetectedImage]) -> str:
    """Tasks with predictions: `rectanglelabels` of a control `label` for an `Image` named `image`."""
    return _json(
        [
            {
                "data": {"image": image.name},
                "predictions": [
                    {
                        "model_version": "pavetwin",
                        "score": round(max((thing.confidence for thing in image.things), default=0.0), 4),
                        "result": [_region(thing, at, image.size_px) for at, thing in enumerate(image.things)],
                    }
                ],
            }
            for image in images
        ]
    )


def _region(thing: DetectedThing, at: int, size: tuple[int, int]) -> dict[str, Any]:
    left, top, right, bottom = thing.box
    across, down = 100 / size[0], 100 / size[1]
    return {
        "id": f"r{at + 1}",
        "type": "rectanglelabels",
        "from_name": "label",
        "to_name": "image",
        "original_width": size[0],
        "original_height": size[1],
        "image_rotation": 0,
        "score": round(thing.confidence, 4),
        "value": {
            "x": round(left * across, 4),
            "y": round(top * down, 4),
            "width": round((right - left) * across, 4),
            "height": round((bottom - top) * down, 4),
            "rotation": 0,
            "rectanglelabels": [thing.name],
        },
        "meta": {"text": [f"{name} {value}" for name, value in thing.attributes.items()]},
    }


def table(images: Sequence[DetectedImage]) -> str:
    """A row for each detection; sizes and places are empty where they are not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for image in images:
        for thing in image.things:
            confidences = (thing.confidence, thing.detection, thing.subtype)
            longitude, latitude = _middle(thing.ground) if thing.ground else ("", "")
            sizes = [thing.sizes.get(name, "") for name in MEASURED]
            row = [image.name, thing.name, *(f"{each:.4f}" for each in confidences), *thing.box]
            writer.writerow([*row, *sizes, longitude, latitude])
    return text.getvalue()


def geojson(images: Sequence[DetectedImage]) -> str | None:
    """A feature for each detection of a photograph that knows its position; None where none does.

    The box's outline on the ground where the photograph tells how the camera looked, or else the camera's own place:
    the property `place` says which.
    """
    features = []
    for image in images:
        for thing in image.things:
            if thing.ground is None and image.lonlat is None:
                continue
            about = {"image": image.name, "class": thing.name, "confidence": round(thing.confidence, 4)}
            about |= {**thing.attributes, "place": "ground" if thing.ground else "camera"}
            features.append({"type": "Feature", "geometry": _geometry(thing, image), "properties": about})
    if not any(image.lonlat for image in images):
        return None
    return _json({"type": "FeatureCollection", "features": features})


def _geometry(thing: DetectedThing, image: DetectedImage) -> dict[str, Any]:
    if thing.ground is None:
        return {"type": "Point", "coordinates": image.lonlat}
    # The right-hand rule of RFC 7946: counter-clockwise on the earth, which clockwise in the picture is not.
    ring = [*reversed(thing.ground)]
    return {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}


def _middle(ring: Sequence[LonLat]) -> LonLat:
    count = len(ring)
    return round(sum(place[0] for place in ring) / count, 8), round(sum(place[1] for place in ring) / count, 8)


def _json(content: Any) -> str:
    return json.dumps(content, ensure_ascii=False, indent=1) + "\n"
