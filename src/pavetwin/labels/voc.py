"""Pascal VOC files: one XML document an image.

Boxes count pixels from 1 and include their last, as in the VOC development kit. Ignored objects are `difficult`, which
VOC's own evaluation leaves out. Elements `pavetwin` hold what VOC cannot express; VOC readers skip them.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final
from xml.etree import ElementTree

from pavetwin.labels.boxes import PixelBox

PICTURES: Final = "JPEGImages"
ANNOTATIONS: Final = "Annotations"

_FORBIDDEN: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


@dataclass(frozen=True, slots=True)
class VocObject:
    """One object of an image."""

    name: str
    box: PixelBox
    difficult: bool
    truncated: bool = False
    occluded: bool | None = None
    """None where it is not known."""
    details: Mapping[str, object] = field(default_factory=dict)
    """Values by element of `pavetwin`; those that are None are left out."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Values by name that need not be a name of XML."""


def voc_file(
    picture: str,
    size_px: tuple[int, int],
    source: Mapping[str, object],
    objects: Iterable[VocObject],
    *,
    details: Mapping[str, object] | None = None,
    attributes: Mapping[str, str] | None = None,
) -> bytes:
    """The content of an image's file.

    Args:
        picture: name of the picture's file.
        size_px: width, height.
        source: elements of `source`.
        details: elements of `pavetwin`, besides those of the objects; no such element unless given.
        attributes: values by name in `pavetwin`.
    """
    root = ElementTree.Element("annotation")
    _add_texts(root, folder=PICTURES, filename=picture)
    _add_texts(ElementTree.SubElement(root, "source"), **source)
    width, height = size_px
    _add_texts(ElementTree.SubElement(root, "size"), width=width, height=height, depth=3)
    _add_texts(root, segmented=0)
    for each in objects:
        _add_object(root, each)
    if details is not None:
        _add_details(root, details, attributes or {})
    ElementTree.indent(root)
    return (ElementTree.tostring(root, encoding="unicode") + "\n").encode()


def _add_object(root: ElementTree.Element, each: VocObject) -> None:
    node = ElementTree.SubElement(root, "object")
    occluded = None if each.occluded is None else int(each.occluded)
    _add_texts(node, name=each.name, pose="Unspecified", truncated=int(each.truncated), occluded=occluded)
    _add_texts(node, difficult=int(each.difficult))
    left, top, right, bottom = each.box
    _add_texts(ElementTree.SubElement(node, "bndbox"), xmin=left + 1, ymin=top + 1, xmax=right, ymax=bottom)
    _add_details(node, each.details, each.attributes)


def _add_details(node: ElementTree.Element, details: Mapping[str, object], attributes: Mapping[str, str]) -> None:
    extra = ElementTree.SubElement(node, "pavetwin")
    _add_texts(extra, **details)
    for name, value in sorted(attributes.items()):
        _add_texts(ElementTree.SubElement(extra, "attribute"), name=name, value=value or None)


def _add_texts(node: ElementTree.Element, **values: object) -> None:
    for tag, value in values.items():
        if value is not None:
            ElementTree.SubElement(node, tag).text = _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", str(value))
