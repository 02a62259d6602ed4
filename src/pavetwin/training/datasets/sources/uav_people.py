"""Top-view pedestrian recognition: people from the air, YOLO boxes of one class."""

from pavetwin.training.datasets.layouts import YoloLayout
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "uav-people",
    DatasetSource(
        title="Top-view pedestrian recognition (reference 26 of arXiv:2606.20742: 215 images, 17,034 people)",
        licence="see its page",
        labels=YoloLayout(names=("person",)),
        classes=dict.fromkeys(("person", "people", "pedestrian"), "Person"),
    ),
)
