"""Looks of streets as data: pavements, and which of them a town's streets have."""

from pavetwin.scene.ground.styles.marking_standard import Mark, mark
from pavetwin.scene.ground.styles.pavement import Pavement, pavement
from pavetwin.scene.ground.styles.street_style import (
    DEFAULT_STYLE,
    StreetStyle,
    street_style,
    style_names,
    style_sha256,
)

__all__ = [
    "DEFAULT_STYLE",
    "Mark",
    "Pavement",
    "StreetStyle",
    "mark",
    "pavement",
    "street_style",
    "style_names",
    "style_sha256",
]
