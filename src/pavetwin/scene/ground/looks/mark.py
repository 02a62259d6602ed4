"""A painted mark: paint on carriageways that follows no standard's lines, such as a utility's or a symbol. A YAML file
each."""

from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from itertools import pairwise
from typing import Annotated, Final, Literal

from pydantic import Field, field_validator

from pavetwin.config.named import names_in, read_named
from pavetwin.config.settings import NUMBER, SOME, PlacedValueError, Settings, Title, Weight
from pavetwin.scene.ground.looks.pavement import PACKAGE
from pavetwin.scene.ground.looks.values import ValueRange, Within

PaintName = Literal["white", "yellow", "orange", "red", "blue", "green"]

StrokeM = Annotated[float, Field(ge=-40, le=40), NUMBER]
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

    title: Title
    """Name in messages."""
    colours: Annotated[Mapping[PaintName, Weight], Field(min_length=1), SOME]
    """Weights of the colours."""
    strokes: Annotated[tuple[Stroke, ...], Field(min_length=1)]
    """Lines of at least two points, with no point repeated in a row: metres along the street and to its left."""
    width_m: Annotated[float, Field(ge=0.03, le=1.0), NUMBER]
    """Width of the strokes."""
    position: MarkPosition
    """Place of the origin: anywhere, mid-lane, at the kerb, or in the middle of a bicycle lane."""
    streets: Literal["all", "main", "other"] = "all"
    """Streets that may have it."""
    turned: bool = False
    """Arbitrary rotation instead of alignment with the street."""
    scale: Annotated[ValueRange, Within(0.1, 10.0)] = ValueRange(least=1.0, most=1.0)
    """Factor on lengths; the stroke width is unaffected."""
    wear: Annotated[ValueRange, Within(0.0, WORN)]
    """Wear of the paint: 0 new, 1 gone."""

    @field_validator("strokes")
    @classmethod
    def _drawn(cls, strokes: tuple[Stroke, ...]) -> tuple[Stroke, ...]:
        for number, stroke in enumerate(strokes):
            for index, (point, after) in enumerate(pairwise(stroke)):
                if point == after:
                    raise PlacedValueError((number,), f"points {index + 1} and {index + 2} are the same")
        return strokes


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
