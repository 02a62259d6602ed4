"""RDD2022, China drone subset (Arya et al. 2022): 512 × 512 pixels from a low UAV, Pascal VOC."""

from pavetwin.training.datasets.layouts import VocLayout
from pavetwin.training.datasets.rules import DROP, IGNORE
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "rdd2022-china-drone",
    DatasetSource(
        title="RDD2022, China drone subset (Arya et al. 2022)",
        home="https://github.com/sekilab/RoadDamageDetector",
        licence="CC BY-SA 4.0 as copies of it state; cite it",
        labels=VocLayout(),
        classes={
            "D00": "Single Crack",
            "D10": "Single Crack",
            "D20": "Crocodile Crack",
            "D40": "Pothole",
            "Repair": DROP,
            # It is damage, so it is not background either.
            "Block crack": IGNORE,
        },
    ),
)
