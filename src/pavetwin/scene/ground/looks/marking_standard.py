"""Marking standards: sizes and colours of road markings by country. A YAML file each."""

from enum import StrEnum
from functools import cache
from typing import Annotated, Literal

import shapely
from pydantic import Field, field_validator

from pavetwin.config.base import Settings
from pavetwin.config.mission import Share
from pavetwin.config.named import names_in, read_named
from pavetwin.scene.ground.looks.mark import PaintName
from pavetwin.scene.ground.looks.pavement import PACKAGE

WidthM = Annotated[float, Field(ge=0.05, le=1.2)]
LengthM = Annotated[float, Field(ge=0.1, le=20)]
Dash = tuple[LengthM, LengthM]
"""Painted and free length [m]."""
LongitudeDeg = Annotated[float, Field(ge=-180, le=180)]
LatitudeDeg = Annotated[float, Field(ge=-90, le=90)]
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


Crossings = Annotated[dict[CrossingKind, Annotated[float, Field(ge=0)]], Field(min_length=1)]
"""Kinds with their relative frequencies."""


class Hatching(Settings):
    """Areas to keep off: bars between border lines."""

    colour: PaintName = "white"
    border_m: WidthM = 0.12
    """Width of the line around an area."""
    stripe_m: Dash = (0.5, 0.5)
    """Painted and free, across the bars."""
    angle_deg: Annotated[float, Field(ge=15, le=75)] = 45.0
    """Of the bars to the street."""
    corner_share: Share = 0.0
    """Of ends of parking lanes that are kept free before junctions and crossings."""
    junction_share: Share = 0.0
    """Of junctions of main streets: where no way leads across."""


class BoxJunction(Settings):
    """Crossed lines over the middle of a junction that is to be kept clear."""

    colour: PaintName = "yellow"
    line_m: WidthM = 0.15
    every_m: LengthM
    """Between its lines."""
    share: Share
    """Of signalled junctions."""


class RumbleStrips(Settings):
    """Groups of bars across a lane before a place to give way or a crossing without signals, felt by drivers."""

    kind: Literal["painted", "milled"]
    """Raised bars of paint, or grooves."""
    colour: PaintName = "white"
    bar_m: Dash
    """Length along the lane and gap."""
    bars: Annotated[int, Field(ge=1, le=30)]
    """In a group."""
    groups: Annotated[int, Field(ge=1, le=10)] = 1
    groups_every_m: LengthM = 10.0
    before_m: LengthM = 8.0
    """From the nearest one to where vehicles wait."""
    main_share: Share = 0.0
    other_share: Share = 0.0
    """Of approaches on main and on other streets."""


class MarkingStandard(Settings):
    """The road markings of a country. Widths and lengths in metres."""

    title: str
    areas: tuple[Outline, ...] = ()
    """Where it holds, in degrees: rough outlines of the country. The first standard by name wins."""
    line_m: WidthM
    """Width of lane lines."""
    centre_m: WidthM
    """Width of the line between directions."""
    broad_m: WidthM
    """Width of lines beside bicycle lanes."""
    lane_dash_m: Dash
    centre_dash_m: Dash
    centre_colour: PaintName = "white"
    solid_centre_share: Share
    """Of main streets with one lane each way."""
    double_solid: bool
    """Whether solid centre lines of such streets are double; those of wider streets always are."""
    double_gap_m: WidthM
    """Between the two lines of a double centre line."""
    edge_share: Share = 0.3
    """Of main streets with a line along the kerb."""
    edge_colour: PaintName = "white"
    left_edge_colour: PaintName | None = None
    """Of the left edge of one-way main streets; None where it has no line."""
    kerb_colour: PaintName | None = None
    """Of lines along kerbs where stopping is forbidden; None where there are none."""
    kerb_share: Share = 0.0
    """Of other streets that have them."""
    stop_m: WidthM
    """Width of a stop line."""
    give_way: Literal["dashes", "triangles"]
    give_way_dash_m: Dash
    """Of a give-way line as wide as a stop line; of triangles their width and the gap between them."""
    give_way_m: WidthM
    """Its width across; the height of triangles."""
    stripe_m: Dash
    """Of crossings with stripes: painted and free."""
    crossing_colour: PaintName = "white"
    signalled: Crossings
    """Of crossings with signals."""
    unsignalled: Crossings
    """Of all others."""
    crossing_line_m: WidthM
    crossing_dash_m: Dash | None = None
    """Of the two lines of a crossing; None for solid ones."""
    hatching: Hatching | None = None
    box: BoxJunction | None = None
    rumble: RumbleStrips | None = None

    @field_validator("areas")
    @classmethod
    def _simple(cls, areas: tuple[Outline, ...]) -> tuple[Outline, ...]:
        for number, outline in enumerate(areas, start=1):
            if not shapely.Polygon(outline).is_valid:
                raise ValueError(f"outline {number} crosses itself")
        return areas

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
