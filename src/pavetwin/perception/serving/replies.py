"""What the server answers: detections in our form, and in that of the paper's public server."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from pavetwin.perception.results.detected_image import DetectedImage


def _own(image: DetectedImage) -> dict[str, Any]:
    return {
        "name": image.name,
        "width": image.size_px[0],
        "height": image.size_px[1],
        "detections": [
            {
                "class": thing.name,
                "class_id": thing.number,
                "confidence": round(thing.confidence, 4),
                "det_conf": round(thing.detection, 4),
                "cls_conf": round(thing.subtype, 4),
                "box": list(thing.box),
                "outline": [list(corner) for corner in thing.outline or ()],
                "sizes": dict(thing.sizes),
                "ground": [list(corner) for corner in thing.ground or ()],
            }
            for thing in image.things
        ],
    }


def _rdmo(image: DetectedImage) -> list[dict[str, Any]]:
    return [
        {
            "clase": thing.name,
            "det_conf": round(thing.detection, 4),
            "cls_conf": round(thing.subtype, 4),
            "caja": list(thing.box),
        }
        for thing in image.things
    ]


FORMS: Final[Mapping[str, Callable[[DetectedImage], Any]]] = {"json": _own, "rdmo": _rdmo}
"""By the name that `?format=` asks for; the first unless asked."""
