"""UAPD: pavement from a UAV, 512 × 512 pixels, Pascal VOC. Classes are spelled out or abbreviated."""

from pavetwin.training.datasets.layouts import VocLayout
from pavetwin.training.datasets.rules import DROP
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "uapd",
    DatasetSource(
        title="UAPD",
        home="https://github.com/tantantetetao/UAPD-Pavement-Distress-Dataset",
        licence="released for public use",
        labels=VocLayout(),
        classes={
            **dict.fromkeys(("longitudinal crack", "LC"), "Single Crack"),
            **dict.fromkeys(("transverse crack", "TC"), "Single Crack"),
            **dict.fromkeys(("oblique crack", "OC"), "Single Crack"),
            **dict.fromkeys(("alligator crack", "AC"), "Crocodile Crack"),
            **dict.fromkeys(("pothole", "PH"), "Pothole"),
            **dict.fromkeys(("repair", "RP"), DROP),
        },
    ),
)
