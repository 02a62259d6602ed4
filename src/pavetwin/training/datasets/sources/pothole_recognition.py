"""Pothole-Recognition (Silva et al. 2020): UAV images, YOLO boxes, classes named in Spanish."""

from pavetwin.training.datasets.layouts import YoloLayout
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "pothole-recognition",
    DatasetSource(
        title="Pothole-Recognition (Silva et al. 2020)",
        home="https://github.com/luisaugustos/Pothole-Recognition",
        licence="none stated",
        labels=YoloLayout(names=("agujero", "grietas")),
        classes={
            "agujero": "Pothole",
            "pothole": "Pothole",
            "grietas": "Single Crack",
            "crack": "Single Crack",
        },
    ),
)
