"""UAV-PDD2023: pavement from a UAV at 30 m, Pascal VOC; labels of `X.jpg` are in `X.xml` or `X_annotation.xml`."""

from pavetwin.training.datasets.layouts import VocLayout
from pavetwin.training.datasets.rules import DROP
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "uav-pdd2023",
    DatasetSource(
        title="UAV-PDD2023",
        home="https://zenodo.org/records/8429208",
        licence="CC BY 4.0",
        labels=VocLayout(ending="_annotation"),
        classes={
            "longitudinal crack": "Single Crack",
            "transverse crack": "Single Crack",
            "oblique crack": "Single Crack",
            "alligator crack": "Crocodile Crack",
            "pothole": "Pothole",
            "repair": DROP,
        },
    ),
)
