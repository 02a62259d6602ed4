"""PothRGBD: potholes as YOLO polygons, of which each becomes the box around it."""

from pavetwin.datasets.layouts import YoloLayout
from pavetwin.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "pothrgbd",
    DatasetSource(
        title="PothRGBD",
        licence="see its page",
        labels=YoloLayout(names=("pothole",), polygons=True),
        classes={"pothole": "Pothole"},
    ),
)
