"""Looks of streets as data: pavements, and which of them a town's streets have."""

from pavetwin.scene.ground.looks.marking_standard import Mark, mark
from pavetwin.scene.ground.looks.pavement import Pavement, pavement
from pavetwin.scene.ground.looks.street_look import DEFAULT_LOOK, StreetLook, look_names, look_sha256, street_look

__all__ = [
    "DEFAULT_LOOK",
    "Mark",
    "Pavement",
    "StreetLook",
    "look_names",
    "look_sha256",
    "mark",
    "pavement",
    "street_look",
]
