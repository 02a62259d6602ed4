"""Painted marks, and marking standards by country: sizes and colours. A YAML file each."""

from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from itertools import pairwise
from typing import Annotated, Final, Literal, Self

import shapely
from pydantic import Field, field_validator, model_validator

from pavetwin.config.named import names_in, read_named
from pavetwin.config.settings import NUMBER, SOME, PlacedValueError, Settings, Share, Title, Weight
from pavetwin.scene.ground.styles.pavement import PACKAGE
from pavetwin.scene.ground.styles.values import ValueRange, Within

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


@cache
def mark(name: str) -> Mark:
    """The mark of a name, or of a YAML file of the user's own.

    Raises:
        PaveTwinError: there is no such mark or file, or the file is none.
    """
    return read_named(Mark, name, what="mark", key="marks", package=PACKAGE, folder="marks")


WidthM = Annotated[float, Field(ge=0.05, le=1.2), NUMBER]
LengthM = Annotated[float, Field(ge=0.1, le=20), NUMBER]
Dash = tuple[LengthM, LengthM]
"""Painted and free length [m]."""
LongitudeDeg = Annotated[float, Field(ge=-180, le=180), NUMBER]
LatitudeDeg = Annotated[float, Field(ge=-90, le=90), NUMBER]
Outline = Annotated[tuple[tuple[LongitudeDeg, LatitudeDeg], ...], Field(min_length=3)]
"""The corners of a polygon: longitude and latitude."""


class CrossingKind(StrEnum):
    """How a crossing of pedestrians is painted."""

    STRIPES = "stripes"
    """Bars along the carriageway."""
    LINES = "lines"
    """Two lines across it."""
    LADDER = "ladder"
    """Both."""
    NONE = "none"


Crossings = Annotated[dict[CrossingKind, Weight], Field(min_length=1), SOME]
"""Kinds with their relative frequencies."""


class Hatching(Settings):
    """Areas to keep off: bars between border lines."""

    colour: PaintName = "white"
    """Colour of bars and borders."""
    border_m: WidthM = 0.12
    """Width of the border line."""
    stripe_m: Dash = (0.5, 0.5)
    """Painted and free length, across the bars."""
    angle_deg: Annotated[float, Field(ge=15, le=75), NUMBER] = 45.0
    """Angle between the bars and the street."""
    corner_share: Share = 0.0
    """Share of the parking-lane ends kept clear before junctions and crossings."""
    junction_share: Share = 0.0
    """Share of the junctions of main streets, hatched where no path crosses."""

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if not {"corner_share", "junction_share"} & self.model_fields_set:
            raise ValueError("nothing is hatched; give corner_share or junction_share")
        return self


class BoxJunction(Settings):
    """Crossed lines over the middle of a junction that is to be kept clear."""

    colour: PaintName = "yellow"
    """Colour of the lines."""
    line_m: WidthM = 0.15
    """Width of the lines, below `every_m`."""
    every_m: LengthM
    """Distance between the lines."""
    share: Share
    """Share of the signalled junctions."""

    @model_validator(mode="after")
    def _apart(self) -> Self:
        if self.every_m <= self.line_m:
            raise PlacedValueError(("every_m",), f"lines {self.line_m:g} m wide leave nothing free between them")
        return self


class RumbleStrips(Settings):
    """Groups of bars across a lane before a place to give way or a crossing without signals, felt by drivers."""

    kind: Literal["painted", "milled"]
    """Raised bars of paint, or grooves."""
    colour: PaintName = "white"
    """Colour of painted bars."""
    bar_m: Dash
    """Length of bar and gap along the lane."""
    bars: Annotated[int, Field(ge=1, le=30), NUMBER]
    """Bars per group."""
    groups: Annotated[int, Field(ge=1, le=10), NUMBER] = 1
    """Number of groups in a row."""
    groups_every_m: LengthM = 10.0
    """Distance between groups, at least their length."""
    before_m: LengthM = 8.0
    """Distance from the last group to the waiting position."""
    main_share: Share = 0.0
    """Share of the approaches on main streets."""
    other_share: Share = 0.0
    """Share of the approaches on other streets."""

    @model_validator(mode="after")
    def _apart(self) -> Self:
        long_m = self.bars * sum(self.bar_m)
        if self.groups > 1 and self.groups_every_m < long_m:
            raise PlacedValueError(
                ("groups_every_m",), f"groups of {self.bars} bars are {long_m:g} m long and would overlap"
            )
        if not {"main_share", "other_share"} & self.model_fields_set:
            raise ValueError("no street has any; give main_share or other_share")
        return self


class MarkingStandard(Settings):
    """The road markings of a country. Widths and lengths in metres."""

    title: Title
    """Name of the country in messages."""
    areas: tuple[Outline, ...] = ()
    """Rough outlines of the country in degrees, longitude and latitude; the first standard by name wins. Without it,
    only styles select it."""
    line_m: WidthM
    """Width of lane lines."""
    centre_m: WidthM
    """Width of the line between directions."""
    broad_m: WidthM
    """Width of lines next to bicycle lanes."""
    lane_dash_m: Dash
    """Lane lines: painted and free length."""
    centre_dash_m: Dash
    """Lines between directions: painted and free length."""
    centre_colour: PaintName = "white"
    """Colour of lines between directions."""
    solid_centre_share: Share
    """Share of the main streets with one lane each way that have a solid centre line."""
    double_solid: bool
    """Double solid centre lines on such streets; wider streets always have them."""
    double_gap_m: WidthM
    """Gap between the lines of a double centre line."""
    edge_share: Share = 0.3
    """Share of the main streets with a line along the kerb."""
    edge_colour: PaintName = "white"
    """Colour of lines along kerbs."""
    left_edge_colour: PaintName | None = None
    """Colour of the left edge of one-way main streets; no line without it."""
    kerb_colour: PaintName | None = None
    """Colour of no-stopping lines along kerbs; needs `kerb_share`."""
    kerb_share: Share = 0.0
    """Share of the other streets with no-stopping lines."""
    stop_m: WidthM
    """Width of a stop line."""
    give_way: Literal["dashes", "triangles"]
    """Dashed line, or row of triangles."""
    give_way_dash_m: Dash
    """Give-way lines: painted and free length; triangles: width and gap."""
    give_way_m: WidthM
    """Width of a give-way line; height of triangles."""
    stripe_m: Dash
    """Striped crossings: painted and free length."""
    crossing_colour: PaintName = "white"
    """Colour of crossings."""
    signalled: Crossings
    """Weights of crossings with signals: bars along the carriageway, two lines across it, both, or nothing."""
    unsignalled: Crossings
    """Weights of all other crossings."""
    crossing_line_m: WidthM
    """Width of the lines across the carriageway at crossings."""
    crossing_dash_m: Dash | None = None
    """Painted and free length of these lines; solid without it."""
    hatching: Hatching | None = None
    """Areas to keep off: bars between border lines. Needs one of its shares."""
    box: BoxJunction | None = None
    """Crossed lines over the middle of a junction that must be kept clear."""
    rumble: RumbleStrips | None = None
    """Groups of bars across a lane before a give-way line or an unsignalled crossing. Needs one of its shares."""

    @field_validator("areas")
    @classmethod
    def _simple(cls, areas: tuple[Outline, ...]) -> tuple[Outline, ...]:
        for number, outline in enumerate(areas, start=1):
            if not shapely.Polygon(outline).is_valid:
                raise PlacedValueError((number - 1,), f"outline {number} crosses itself", named=False)
        return areas

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.kerb_colour is None and self.kerb_share > 0:
            raise PlacedValueError(("kerb_share",), "lines along kerbs need kerb_colour")
        if self.kerb_colour is not None and "kerb_share" not in self.model_fields_set:
            raise PlacedValueError(("kerb_colour",), "no street has such lines; give kerb_share")
        return self

    def holds_at(self, longitude: float, latitude: float) -> bool:
        """Whether a place (WGS 84, degrees) lies in its areas."""
        return any(shapely.intersects_xy(shapely.Polygon(outline), longitude, latitude) for outline in self.areas)


def standard_names() -> list[str]:
    """The marking standards that ship with the package."""
    return names_in(PACKAGE, "standards")


@cache
def marking_standard(name: str) -> MarkingStandard:
    """The standard of a name, or of a YAML file of the user's own.

    Raises:
        PaveTwinError: there is no such standard or file, or the file is none.
    """
    return read_named(
        MarkingStandard, name, what="marking standard", key="markings", package=PACKAGE, folder="standards"
    )
