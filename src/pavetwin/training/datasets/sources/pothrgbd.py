"""PothRGBD: potholes as YOLO polygons, of which each becomes the box around it."""

from pavetwin.training.datasets.layouts import YoloLayout
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "pothrgbd",
    DatasetSource(
        title="PothRGBD (Yurdakul and Tasdemir 2025)",
        home="https://www.kaggle.com/datasets/mahyeks/pothrgbd-rgb-and-depth-images-of-potholes",
        licence="see its page (others report MIT)",
        labels=YoloLayout(names=("pothole",), polygons=True),
        classes={"pothole": "Pothole"},
    ),
)
