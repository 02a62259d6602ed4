"""Blocks of a page as plain values: sections of paragraphs, tables and figures."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, field
from urllib.parse import quote


@dataclass(frozen=True, slots=True)
class TableCell:
    text: str
    strong: bool = False
    aside: str = ""
    """Text after it that is never bold."""


def text_cells(*texts: str) -> tuple[TableCell, ...]:
    return tuple(map(TableCell, texts))


@dataclass(frozen=True)
class Table:
    """Rows under column heads; the first `lead` cells of a row identify it."""

    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]
    lead: int = 2
    notes: Sequence[str] = ()
    span: str = ""
    """Common heading of the columns after the lead."""
    merged: bool = True
    """True if equal lead cells below each other are written once."""
    opened_by: str = ""
    """Text that opens the table on a click; without one it is always visible."""

    def starts(self, row: int, column: int) -> bool:
        """True if a lead cell, or one before it, differs from that of the row above."""
        here, above = self.rows[row], self.rows[row - 1]
        return row == 0 or any(here[at].text != above[at].text for at in range(column + 1))

    def height(self, row: int, column: int) -> int:
        """Number of rows of the lead cell that starts here; 0 if none starts.

        The last lead cell stands for its own row only.
        """
        if column == self.lead - 1 or not self.merged:
            return 1
        if not self.starts(row, column):
            return 0
        below = (at for at in range(row + 1, len(self.rows)) if self.starts(at, column))
        return next(below, len(self.rows)) - row


@dataclass(frozen=True)
class ReportFigure:
    caption: str
    alt: str
    content: bytes
    """Content of its file."""
    suffix: str
    """svg or png."""
    width_px: int
    height_px: int

    @property
    def source(self) -> str:
        """A data URI: the page loads nothing."""
        if self.suffix == "svg":
            text = self.content.decode().replace('"', "'")
            return "data:image/svg+xml," + quote(text, safe=" =:/;,()'@!*+")
        return f"data:image/{self.suffix};base64,{b64encode(self.content).decode('ascii')}"


Block = Table | ReportFigure | str
"""A string is a paragraph."""


@dataclass(frozen=True)
class Section:
    anchor: str
    title: str
    blocks: Sequence[Block] = ()
    sections: Sequence["Section"] = field(default=())

    @property
    def empty(self) -> bool:
        """True if it has only text."""
        return not self.sections and all(isinstance(block, str) for block in self.blocks)
