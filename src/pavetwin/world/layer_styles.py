"""Styles of a GeoPackage's layers in QGIS's own XML (QML): a colour for each value of a column."""

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, SubElement, tostring

from pavetwin.world.layers import STAMP

_DOCTYPE: Final = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


class Symbol(Enum):
    """How a feature is drawn: QGIS's type and class of symbol, and the property that its colour is."""

    DOT = ("marker", "SimpleMarker", "color")
    AREA = ("fill", "SimpleFill", "color")
    OUTLINE = ("fill", "SimpleFill", "outline_color")


_USUAL: Final[Mapping[Symbol, Mapping[str, str]]] = {
    Symbol.DOT: {"name": "circle", "size": "3", "outline_color": "20,20,20,255", "outline_width": "0.2"},
    Symbol.AREA: {"style": "solid", "outline_color": "60,60,60,255", "outline_width": "0.2"},
    Symbol.OUTLINE: {"style": "no", "outline_width": "0.5"},
}


@dataclass(frozen=True)
class LayerStyle:
    """A layer whose features are coloured by the value of one column."""

    column: str
    colours: Mapping[str, str]
    """By value: `#RRGGBB`."""
    symbol: Symbol
    opacity: float = 1.0
    """Of the symbols, 0 … 1."""

    @property
    def qml(self) -> str:
        """The style as QGIS reads it."""
        kind, symbol_class, coloured = self.symbol.value
        root = Element("qgis", {"version": "3.22", "styleCategories": "Symbology|Labeling"})
        renderer = SubElement(
            root, "renderer-v2", {"type": "categorizedSymbol", "attr": self.column, "symbollevels": "0"}
        )
        listed, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
        for number, (value, colour) in enumerate(self.colours.items()):
            told = {"value": value, "label": value, "symbol": str(number), "render": "true"}
            SubElement(listed, "category", told)
            symbol = SubElement(symbols, "symbol", {"type": kind, "name": str(number), "alpha": f"{self.opacity:g}"})
            drawn = SubElement(symbol, "layer", {"class": symbol_class, "enabled": "1", "pass": "0", "locked": "0"})
            options = SubElement(drawn, "Option", {"type": "Map"})
            for key, setting in {**_USUAL[self.symbol], coloured: _rgba(colour)}.items():
                SubElement(options, "Option", {"name": key, "type": "QString", "value": setting})
                SubElement(drawn, "prop", {"k": key, "v": setting})
        return _DOCTYPE + tostring(root, encoding="unicode")


def _rgba(colour: str) -> str:
    return ",".join(str(int(colour[at : at + 2], 16)) for at in (1, 3, 5)) + ",255"


def write_styles(path: Path, styles: Mapping[str, LayerStyle]) -> None:
    """Add the table `layer_styles` to a GeoPackage, in which QGIS looks for the style of a layer that it opens.

    Args:
        styles: by layer; each of them is in the file.
    """
    with closing(sqlite3.connect(path)) as base, base:
        base.execute(
            "CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT, "
            "f_table_schema TEXT, f_table_name TEXT, f_geometry_column TEXT, styleName TEXT, styleQML TEXT, "
            "styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT, ui TEXT, update_time DATETIME)"
        )
        base.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change) "
            "VALUES ('layer_styles', 'attributes', 'layer_styles', '', ?)",
            (STAMP,),
        )
        for layer, style in styles.items():
            (column,) = base.execute(
                "SELECT column_name FROM gpkg_geometry_columns WHERE table_name = ?", (layer,)
            ).fetchone()
            base.execute(
                "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
                "styleName, styleQML, styleSLD, useAsDefault, description, owner, update_time) "
                "VALUES ('', '', ?, ?, ?, ?, '', 1, '', '', ?)",
                (layer, column, layer, style.qml, STAMP),
            )
