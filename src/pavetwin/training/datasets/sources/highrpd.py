"""HighRPD: pavement from 50 m, crops of 640 × 640 pixels, YOLO boxes."""

from pavetwin.training.datasets.layouts import YoloLayout
from pavetwin.training.datasets.rules import DISCARD
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "highrpd",
    DatasetSource(
        title="HighRPD: a high-altitude drone dataset of road pavement distress (He et al. 2025)",
        home="https://data.mendeley.com/datasets/sywswj7djj/1",
        licence="CC BY 4.0",
        labels=YoloLayout(names=("line", "block", "pit")),
        # From 50 m a pit can hardly be told from a stain, so no image with one is used.
        classes={"line": "Single Crack", "block": "Crocodile Crack", "pit": DISCARD},
    ),
)
