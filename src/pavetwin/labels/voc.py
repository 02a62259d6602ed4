"""Pascal VOC files: one XML document an image; and the reading of XML from untrusted files.

Boxes count pixels from 1 and include their last, as in the VOC development kit. Ignored objects are `difficult`, which
VOC's own evaluation leaves out. Elements `pavetwin` hold what VOC cannot express; VOC readers skip them.

Files are read without entities and document types, and nothing is fetched; each element keeps its line.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler

from defusedxml import DefusedXmlException
from defusedxml.sax import make_parser

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
    """None if unknown."""
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
        picture: name of the image file.
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


LARGEST_BYTES: Final = 16 * 2**20
"""Largest label file of one image."""

DEEPEST: Final = 64
"""Elements within each other."""

MOST_ELEMENTS: Final = 200_000
"""Most elements of a file: enough for about 15,000 objects."""


class XmlError(ValueError):
    """A file is not readable XML; the message states the reason."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


@dataclass(slots=True)
class Element:
    """An element with the line where it begins."""

    tag: str
    line: int
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    def find(self, tag: str) -> "Element | None":
        """The first child of that name."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, tag: str) -> list["Element"]:
        return [child for child in self.children if child.tag == tag]

    def value(self, tag: str) -> str | None:
        """The text of the first child of that name; None where there is none or it is empty."""
        child = self.find(tag)
        return (child.text.strip() or None) if child is not None else None


class _Builder(ContentHandler):
    def __init__(self) -> None:
        super().__init__()
        self.root: Element | None = None
        self._open: list[Element] = []
        self._parts: list[list[str]] = []
        """The text of each open element so far; a parser gives every line by itself."""
        self._locator: Any = None
        self._elements = 0

    def setDocumentLocator(self, locator: Any) -> None:  # noqa: N802 - SAX names it
        self._locator = locator

    @property
    def line(self) -> int:
        """Current line of the parser."""
        return int(self._locator.getLineNumber() or 0)

    def startElement(self, name: str, attrs: Any) -> None:  # noqa: ARG002, N802 - SAX names it
        if len(self._open) >= DEEPEST:
            raise XmlError(f"more than {DEEPEST} elements lie within each other", self.line)
        self._elements += 1
        if self._elements > MOST_ELEMENTS:
            raise XmlError(f"more than {MOST_ELEMENTS} elements, which no label file has", self.line)
        element = Element(name, self.line)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)
        self._parts.append([])

    def endElement(self, name: str) -> None:  # noqa: ARG002, N802 - SAX names it
        self._open.pop().text = "".join(self._parts.pop())

    def characters(self, content: str) -> None:
        self._parts[-1].append(content)


def parse_xml(path: Path) -> Element:
    """The root element of a file.

    Raises:
        XmlError: it is not XML, too large, or has a document type or entities, which label files never need.
    """
    builder, parser = _Builder(), make_parser()
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise XmlError(f"larger than {LARGEST_BYTES >> 20} MiB, which no label file is")
        parser.forbid_dtd = True
        parser.setContentHandler(builder)
        with path.open("rb") as stream:
            parser.parse(stream)
    except DefusedXmlException as error:
        raise XmlError("has a document type or entities, which label files never need", builder.line) from error
    except SAXParseException as error:
        raise XmlError(f"is not XML ({error.getMessage()})", error.getLineNumber()) from error
    except (OSError, ValueError) as error:
        if isinstance(error, XmlError):
            raise
        raise XmlError(f"cannot be read ({type(error).__name__})") from error
    if builder.root is None:
        raise XmlError("is empty")
    return builder.root
