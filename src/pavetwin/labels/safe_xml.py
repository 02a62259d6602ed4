"""XML from anywhere: no entities, no document types, nothing fetched, and the line of every element."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler

from defusedxml import DefusedXmlException
from defusedxml.sax import make_parser

LARGEST_BYTES: Final = 16 * 2**20
"""Largest label file of one image."""

DEEPEST: Final = 64
"""Elements within each other."""

MOST_ELEMENTS: Final = 200_000
"""Most elements of a file: enough for about 15,000 objects."""


class XmlError(ValueError):
    """A file is not XML that can be read; the message states the reason."""

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
