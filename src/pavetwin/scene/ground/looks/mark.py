"""A painted mark: paint on carriageways that follows no standard's lines, such as a utility's or a symbol. A YAML file
each."""

from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from pavetwin.config.base import Settings
from pavetwin.config.named import names_in, read_named
from pavetwin.scene.ground.looks.pavement import PACKAGE
from pavetwin.scene.ground.looks.values import ValueRange

PaintName = Literal["white", "yellow", "orange", "red", "blue", "green"]

StrokeM = Annotated[float, Field(ge=-40, le=40)]
Stroke = Annotated[tuple[tuple[StrokeM, StrokeM], ...], Field(min_length=2)]
"""A line in metres: along the street, and to its left."""

WORN: Final = 0.95


class MarkPosition(StrEnum):
    """Where on a street a mark's origin lies."""

    ANYWHERE = "anywhere"
    LANE = "lane"
    """In the middle of a driving lane, along its traffic."""
    KERB = "kerb"
    """At the kerb, its left towards the middle of the street."""
    BICYCLE = "bicycle"
    """In the middle of a bicycle lane, along its traffic."""


class Mark(Settings):
    """A painted mark."""

    title: str
    colours: Annotated[Mapping[PaintName, Annotated[float, Field(gt=0)]], Field(min_length=1)]
    """With their relative frequencies."""
    strokes: Annotated[tuple[Stroke, ...], Field(min_length=1)]
    width_m: Annotated[float, Field(ge=0.03, le=1.0)]
    """Of its strokes."""
    position: MarkPosition
    streets: Literal["all", "main", "other"] = "all"
    turned: bool = False
    """Whether it lies at any angle, not along the street."""
    scale: ValueRange = ValueRange(least=1.0, most=1.0)
    """Factor on its lengths; strokes keep their width."""
    wear: ValueRange
    """Of its paint, 0 … 1."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for name, low, high in (("scale", 0.1, 10.0), ("wear", 0.0, WORN)):
            values: ValueRange = getattr(self, name)
            if values.least < low or values.most > high:
                raise ValueError(f"{name}: least and most lie between {low:g} and {high:g}")
        return self


def mark_names() -> list[str]:
    """The marks that ship with the package."""
    return names_in(PACKAGE, "marks")


@cache
def mark(name: str) -> Mark:
    """The mark of a name, or of a YAML file of the user's own.

    Raises:
        PaveTwinError: there is no such mark or file, or the file is none.
    """
    return read_named(Mark, name, what="mark", key="marks", package=PACKAGE, folder="marks")
