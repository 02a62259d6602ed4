"""Styles of the inventory's layers in QGIS's own XML (QML): a colour for each class."""

from collections.abc import Mapping
from typing import Final
from xml.etree.ElementTree import Element, SubElement, tostring

from pavetwin.labels.classes import categories, category_colours

_DOCTYPE: Final = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"

_SYMBOLS: Final[Mapping[str, tuple[str, str, Mapping[str, str]]]] = {
    "defects": (
        "marker",
        "SimpleMarker",
        {"name": "circle", "size": "3", "outline_color": "20,20,20,255", "outline_width": "0.2"},
    ),
    "outlines": ("fill", "SimpleFill", {"style": "no", "outline_width": "0.5"}),
}
"""By layer: QGIS's type of symbol, its class, and its properties but for the colour."""


def _style(layer: str) -> str:
    kind, symbol_class, properties = _SYMBOLS[layer]
    root = Element("qgis", {"version": "3.22", "styleCategories": "Symbology|Labeling"})
    renderer = SubElement(root, "renderer-v2", {"type": "categorizedSymbol", "attr": "class", "symbollevels": "0"})
    listed, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
    defects = [category.name for category in categories() if category.supercategory == "defect"]
    colour_of = category_colours()
    for number, name in enumerate(defects):
        SubElement(listed, "category", {"value": name, "label": name, "symbol": str(number), "render": "true"})
        symbol = SubElement(symbols, "symbol", {"type": kind, "name": str(number), "alpha": "1"})
        drawn = SubElement(symbol, "layer", {"class": symbol_class, "enabled": "1", "pass": "0", "locked": "0"})
        colour = "outline_color" if kind == "fill" else "color"
        options = SubElement(drawn, "Option", {"type": "Map"})
        for key, value in {**properties, colour: _rgba(colour_of[name])}.items():
            SubElement(options, "Option", {"name": key, "type": "QString", "value": value})
            SubElement(drawn, "prop", {"k": key, "v": value})
    return _DOCTYPE + tostring(root, encoding="unicode")


def _rgba(colour: str) -> str:
    return ",".join(str(int(colour[at : at + 2], 16)) for at in (1, 3, 5)) + ",255"


STYLES: Final[Mapping[str, str]] = {layer: _style(layer) for layer in _SYMBOLS}
"""QML by layer."""
