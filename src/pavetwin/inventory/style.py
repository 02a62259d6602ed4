"""Styles of the inventory's layers in QGIS: a colour for each class."""

from collections.abc import Mapping
from typing import Final

from pavetwin.labels.classes import categories, category_colours
from pavetwin.world.layers import LayerStyle, Symbol

_COLOURS: Final = {
    category.name: category_colours()[category.name] for category in categories() if category.supercategory == "defect"
}

STYLES: Final[Mapping[str, LayerStyle]] = {
    "defects": LayerStyle("class", _COLOURS, Symbol.DOT),
    "outlines": LayerStyle("class", _COLOURS, Symbol.OUTLINE),
}
"""By layer."""
