"""Marking standards: sizes and colours of road markings by country. A YAML file each."""

from enum import StrEnum
from functools import cache
from typing import Annotated, Final, Literal

from pydantic import Field

from pavetwin.config.base import Settings
from pavetwin.config.mission import Share
from pavetwin.config.named import names_in, read_named
from pavetwin.scene.ground.looks.mark import PaintName
from pavetwin.scene.ground.materials.compose import PAINTS
from pavetwin.world.model import World

PACKAGE: Final = "pavetwin.scene.ground.markings"
FALLBACK: Final = "germany"
"""Where no standard's country lies."""

WidthM = Annotated[float, Field(ge=0.05, le=1.2)]
LengthM = Annotated[float, Field(ge=0.1, le=20)]
Dash = tuple[LengthM, LengthM]
"""Painted and free length [m]."""
BoundDeg = Annotated[float, Field(ge=-180, le=180)]
GeoBox = tuple[BoundDeg, BoundDeg, BoundDeg, BoundDeg]
"""West, south, east, north."""


def paint(colour: PaintName) -> float:
    """The place of a colour among the paints, 0 … 1, as maps hold it."""
    return list(PAINTS).index(colour) / (len(PAINTS) - 1)


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


class MarkingStandard(Settings):
    """The road markings of a country. Widths and lengths in metres."""

    title: str
    areas: tuple[GeoBox, ...] = ()
    """Where it holds, in degrees: boxes that hold most of the country. The first standard by name wins."""
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


def standard_of(world: World) -> MarkingStandard:
    """The standard of a world's place."""
    if not world.segments:
        return marking_standard(FALLBACK)
    longitude, latitude = world.georeference.to_wgs84(world.segments[0].centre_line.coords[0])
    for name in standard_names():
        for west, south, east, north in marking_standard(name).areas:
            if west <= longitude <= east and south <= latitude <= north:
                return marking_standard(name)
    return marking_standard(FALLBACK)
